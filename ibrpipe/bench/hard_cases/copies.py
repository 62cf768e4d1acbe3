"""Cells of scenes of copies: coverage, leaks, colour and depth against all copies taken apart."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import ndimage

from ibrpipe.bench.cases.case import CopiesCase, SceneShot
from ibrpipe.bench.hard_cases.frames import Spot, WrongPixels, render_twice
from ibrpipe.bench.hard_cases.posed import finite
from ibrpipe.bench.hard_cases.results import Cell, Figures, Limits
from ibrpipe.bench.oracles.copies import ExactPicture, cast_scene
from ibrpipe.bench.settings import Limit, Setting
from ibrpipe.types import Array, Frame

#: nearest depth that is drawn, over the radius of the scene, as the renderer has it by default
NEAR = 1e-6


def copies_cells(
    case: CopiesCase, settings: Sequence[Setting], pictures: dict[tuple[str, str], WrongPixels], inputs: Sequence[str]
) -> list[Cell]:
    """Return the cells of one case; frames with wrong pixels go to `pictures`."""
    if not settings:
        return []
    built, cells = case.build(), []
    for dtype in inputs:
        shot = built.given_as(dtype)
        scene = shot.source.scene
        truth = cast_scene(scene, shot.camera, NEAR * scene.bounds[scene.root].radius, shot.side)
        cells += [_cell(Spot(case, setting.label, dtype), shot, truth, setting, pictures) for setting in settings]
    return cells


def _cell(
    spot: Spot,
    shot: SceneShot,
    truth: ExactPicture,
    setting: Setting,
    pictures: dict[tuple[str, str], WrongPixels],
) -> Cell:
    case, limit = spot.case, setting.limit_for(spot.case.name)
    assert isinstance(case, CopiesCase)
    made = render_twice(spot, setting, shot.source, shot.camera)
    if isinstance(made, Cell):
        return made
    frame, same = made
    figures, wrong = _measure(truth, frame, float(shot.camera.K[0, 0]))
    if wrong.any() and spot.input == "float64" and frame.depth is not None:
        pictures[case.name, setting.label] = WrongPixels(truth.depth, frame.depth, wrong)
    limits = _limits(limit, case.colors_tie)
    failures = _exceed(figures, limits) + ([] if same else ["one thread and all threads gave different bytes"])
    return Cell(
        case=case.name, setting=setting.label, input=spot.input, bits=32, status="fail" if failures else "pass",
        failures=failures, message="", same_bytes=same, depth_bytes=None, figures=figures, limits=limits,
    )  # fmt: skip


def _measure(truth: ExactPicture, frame: Frame, focal: float) -> tuple[Figures, Array]:
    """Return the figures, and which pixels (H, W) are wrong; a texel is as wide as a pixel is at the hit."""
    assert frame.color is not None
    assert frame.depth is not None
    assert frame.alpha is not None
    around = np.ones((3, 3))
    solid = ndimage.binary_erosion(truth.cover == 1.0, around, border_value=1)
    empty = ndimage.binary_erosion(truth.cover == 0.0, around, border_value=1)
    nan = ~np.isfinite(frame.color).all(axis=-1) | ~np.isfinite(frame.alpha) | np.isnan(frame.depth)
    lost, extra = solid & (frame.alpha < 0.5), empty & (frame.alpha > 0.5)
    shown = solid & np.isfinite(frame.depth) & np.isfinite(truth.depth) & ~nan
    depth = truth.depth[shown]
    away = np.abs(frame.depth[shown] - depth) * focal / depth
    light = frame.color * frame.alpha[..., None]
    codes = 255.0 * np.abs(light - truth.color).max(axis=-1)[shown]
    area = float(truth.cover.sum())
    figures = Figures(
        pixels=truth.cover.size, hits=int((truth.cover > 0).sum()), doubtful=0, lost=int(lost.sum()),
        extra=int(extra.sum()), astray=0, gross=int((lost | extra).sum()), nan=int(nan.sum()),
        **_ends("texels", away), **_ends("codes", codes),
        **dict.fromkeys(("shift", "shift_p99", "off", "off_p99", "meant", "meant_p99")),
        rmse=float(np.sqrt(np.mean(away**2))) if len(away) else None,
        coverage=finite(float(frame.alpha.sum(dtype=np.float64)) / area - 1.0 if area else float(frame.alpha.sum())),
        leak=finite(float((1.0 - frame.alpha[solid]).mean())) if solid.any() else None,
    )  # fmt: skip
    return figures, lost | extra | nan


def _ends(name: str, values: Array) -> dict[str, float | None]:
    """Largest value and 99th percentile, None where there is none."""
    if not len(values):
        return {name: None, name + "_p99": None}
    return {name: float(values.max()), name + "_p99": float(np.percentile(values, 99))}


def _limits(limit: Limit, colors_tie: str) -> Limits:
    return Limits(
        texels=finite(limit.texels),
        texels_p99=finite(limit.texels_p99),
        shift_p99=None,
        wrong=finite(limit.wrong),
        gross=None,
        codes_p99=None if colors_tie else finite(limit.codes_p99),
        meant=None,
        coverage=finite(limit.coverage),
        leak=finite(limit.leak),
        reason="; ".join([limit.reason, colors_tie] if colors_tie else [limit.reason]),
    )


def _exceed(found: Figures, limits: Limits) -> list[str]:
    """Return what is beyond its limit, in words."""
    told = [f"{found.nan} pixels hold NaN"] if found.nan else []
    wrong = (found.lost + found.extra) / found.pixels
    if limits.wrong is not None and wrong > limits.wrong:
        told.append(f"{found.lost} lost, {found.extra} extra of {found.pixels} pixels; at most {limits.wrong:.2%}")
    named = {
        "coverage": "of the covered area too much or too little",
        "leak": "seen through covered pixels",
        "texels": "texels of depth at worst",
        "texels_p99": "texels of depth (99th percentile)",
        "codes_p99": "codes of colour (99th percentile)",
    }
    for name, words in named.items():
        value, most = getattr(found, name), getattr(limits, name)
        if value is not None and most is not None and not abs(value) <= most:
            told.append(f"{value:.3g} {words}; at most {most:.3g}")
    return told
