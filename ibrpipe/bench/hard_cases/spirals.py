"""Cells of the spiral cases: view-dependent colour against its exact value."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ibrpipe.bench.cases import SpiralCase
from ibrpipe.bench.cases.spirals import build_spiral, expected, spiral_camera
from ibrpipe.bench.hard_cases.frames import ALIKE, Spot, plain_cell, render_twice
from ibrpipe.bench.hard_cases.posed import finite
from ibrpipe.bench.hard_cases.results import Cell, Figures, Limits
from ibrpipe.bench.settings import Setting
from ibrpipe.renderers.registry import shows_view_dependence
from ibrpipe.types import Array, Camera
from ibrpipe.types.renderable import GridSource

#: largest error of view-dependent colour, in 8-bit codes of linear light
SPIRAL_CODES = 0.05


def spiral_cells(
    case: SpiralCase, settings: Sequence[Setting], inputs: Sequence[str], depths: Sequence[int]
) -> list[Cell]:
    """Return the cells of one spiral case."""
    cells = []
    for dtype in inputs:
        texture, camera = build_spiral(case.k, case.zero, dtype), spiral_camera(*case.direction, dtype)
        wanted = expected(texture, camera)
        for setting in settings:
            spots = [Spot(case, setting.label, dtype, bits) for bits in depths]
            if not shows_view_dependence(setting.renderer) or setting.first_layer:
                reason = "shows no view-dependent colour, or that of samples beside the hit"
                cells += [plain_cell(spot, "not applicable", message=reason) for spot in spots]
                continue
            for spot in spots:
                if spot.bits == 32:
                    cells.append(_spiral_cell(spot, setting, texture, camera, wanted))
                else:
                    cells.append(plain_cell(spot, "not applicable", message=ALIKE))
    return cells


def _spiral_cell(spot: Spot, setting: Setting, texture: GridSource, camera: Camera, wanted: Array) -> Cell:
    made = render_twice(spot, setting, texture, camera)
    if isinstance(made, Cell):
        return made
    frame, same = made
    assert frame.color is not None
    codes = 255.0 * np.abs(frame.color - wanted).max(axis=-1)
    nan, lost = int(np.isnan(codes).sum()), int((~np.isfinite(frame.depth)).sum()) if frame.depth is not None else 0
    worst, p99 = float(np.nanmax(codes)), float(np.nanpercentile(codes, 99))
    reason = "float64 arithmetic on float32 residuals: a twentieth of an 8-bit code"
    failures = [f"{nan} pixels hold NaN"] if nan else []
    if lost:
        failures.append(f"{lost} pixels lost")
    if not worst <= SPIRAL_CODES:
        failures.append(f"{worst:.3g} codes of colour at worst; at most {SPIRAL_CODES}")
    if not same:
        failures.append("one thread and all threads gave different bytes")
    nothing = dict.fromkeys(
        ("texels", "texels_p99", "shift", "shift_p99", "off", "off_p99", "rmse", "meant", "meant_p99")
    )
    figures = Figures(
        pixels=codes.size, hits=codes.size, doubtful=0, lost=lost, extra=0, astray=0, gross=lost, nan=nan,
        codes=finite(worst), codes_p99=finite(p99), **nothing
    )  # fmt: skip
    limits = Limits(
        texels=None,
        texels_p99=None,
        shift_p99=None,
        wrong=0.0,
        gross=0.0,
        codes_p99=SPIRAL_CODES,
        meant=None,
        reason=reason,
    )
    return Cell(
        case=spot.case.name, setting=setting.label, input=spot.input, bits=32,
        status="fail" if failures else "pass", failures=failures, message="", same_bytes=same, depth_bytes=None,
        figures=figures, limits=limits,
    )  # fmt: skip
