"""Cells of pictures of several maps: the nearest hit of all of them, against the oracle of all of them."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from ibrpipe.bench.cases.case import CompositeCase
from ibrpipe.bench.hard_cases.frames import ALIKE, Spot, WrongPixels, cells_of_settings, plain_cell, render_twice
from ibrpipe.bench.hard_cases.posed import Posed, count_samples, exceed, figures_of, hold_limits
from ibrpipe.bench.hard_cases.results import Cell, Limits
from ibrpipe.bench.oracles import fields
from ibrpipe.bench.oracles.surface import Surface
from ibrpipe.bench.settings import Limit, Setting
from ibrpipe.bench.speed_error.measure import measure
from ibrpipe.renderers.registry import find_renderer


def composite_cells(
    case: CompositeCase,
    settings: Sequence[Setting],
    pictures: dict[tuple[str, str], WrongPixels],
    inputs: Sequence[str],
    depths: Sequence[int],
) -> list[Cell]:
    """Return the cells of one case; frames with wrong pixels go to `pictures`."""
    built, cells = case.build(), []
    for dtype in inputs:
        given = [shot.given_as(dtype) for shot in built]
        for bits in depths:
            posed = [Posed(shot.stored(bits), bits, shot.step(bits), shot) for shot in given]
            alike = bits != 32 and not any(each.step for each in posed)
            cell = partial(_cell, posed=posed, pictures=pictures, colors_tie=case.colors_tie)
            cells += cells_of_settings(case, settings, dtype, bits, ALIKE if alike else "", cell)
    return cells


def _cell(
    spot: Spot,
    posed: Sequence[Posed],
    setting: Setting,
    pictures: dict[tuple[str, str], WrongPixels],
    colors_tie: str,
) -> Cell:
    sources, camera = [each.shot.source for each in posed], posed[0].shot.camera
    refused = [type(s).__name__ for s in sources if not isinstance(s, find_renderer(setting.renderer).accepts)]
    if refused or setting.only:
        kind = refused[0] if refused else type(sources[0]).__name__
        return plain_cell(spot, "not applicable", message=f"does not take a {kind}")
    made = render_twice(spot, setting, sources, camera)
    if isinstance(made, Cell):
        return made
    frame, same = made
    surfaces = [each.shot.surface() for each in posed]
    truth = fields.cast_truth(surfaces, camera)
    hits = (truth.depth.ravel(), truth.patch.ravel(), truth.owner.ravel())
    color = fields.colors_at(surfaces, camera, fields.pixel_centers(camera), hits)[0].reshape(*truth.depth.shape, 3)
    errors, maps = measure(surfaces, truth, color, camera, frame)
    if maps.wrong.any() and spot.bits == 32 and spot.input == "float64" and frame.depth is not None:
        pictures[spot.case.name, setting.label] = WrongPixels(truth.depth, frame.depth, maps.wrong)
    limits = _limits(setting.limit_for(spot.case.name), posed, surfaces, truth, colors_tie)
    failures = exceed(errors, None, limits) + ([] if same else ["one thread and all threads gave different bytes"])
    return Cell(
        case=spot.case.name, setting=setting.label, input=spot.input, bits=spot.bits,
        status="fail" if failures else "pass", failures=failures,
        message="", same_bytes=same, depth_bytes=spot.bits // 8 * sum(count_samples(source) for source in sources),
        figures=figures_of(errors, None), limits=limits,
    )  # fmt: skip


def _limits(
    limit: Limit, posed: Sequence[Posed], surfaces: Sequence[Surface], truth: fields.Truth, colors_tie: str
) -> Limits:
    """Return the widest of the maps' limits."""
    each = [hold_limits(limit, one, surface, truth, colors_tie) for one, surface in zip(posed, surfaces, strict=True)]
    names = [name for name in Limits.model_fields if name not in ("reason", "meant")]
    widest = {name: None if None in (values := [getattr(one, name) for one in each]) else max(values) for name in names}
    return Limits(**widest, meant=None, reason=each[0].reason)
