"""Every hard case with every renderer, against the exact answer, with one thread and with all."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from time import perf_counter

import numpy as np

from ibrpipe.bench.cases import Case, CompositeCase, CopiesCase, MeshCase, Refusal, Shot, SpiralCase
from ibrpipe.bench.cases.case import BITS, INPUTS, AnyCase
from ibrpipe.bench.hard_cases.composites import composite_cells
from ibrpipe.bench.hard_cases.copies import copies_cells
from ibrpipe.bench.hard_cases.frames import (
    ALIKE,
    Spot,
    WrongPixels,
    cells_of_settings,
    plain_cell,
    render_twice,
    thread_counts,
)
from ibrpipe.bench.hard_cases.meshes import mesh_cells
from ibrpipe.bench.hard_cases.posed import Posed, count_samples, exceed, figures_of, from_meant, hold_limits, seen
from ibrpipe.bench.hard_cases.results import CaseFacts, Cell, HardCasesModel, SettingFacts
from ibrpipe.bench.hard_cases.spirals import spiral_cells
from ibrpipe.bench.settings import Setting
from ibrpipe.bench.speed_error.measure import measure
from ibrpipe.engine.machine import describe_machine
from ibrpipe.errors import IbrError
from ibrpipe.progress import track
from ibrpipe.renderers.registry import find_renderer

#: pixels by which a camera's rays and its projections may part when its rotation is rounded
APART = 0.1


@dataclass
class HardRun:
    """What a run found.

    Attributes
    ----------
    model : HardCasesModel
    pictures : dict of (case, setting) to WrongPixels
    """

    model: HardCasesModel
    pictures: dict[tuple[str, str], WrongPixels] = field(default_factory=dict)


def run_hard_cases(
    cases: Sequence[AnyCase],
    settings: Sequence[Setting],
    inputs: Sequence[str] = INPUTS,
    depths: Sequence[int] = BITS,
) -> HardRun:
    """Render every case with every setting and hold the errors to their limits.

    Parameters
    ----------
    cases, settings
    inputs : sequence of str
        Types of the arrays that are given.
    depths : sequence of int
        Bits of stored depth.
    """
    began, cells = perf_counter(), []
    pictures: dict[tuple[str, str], WrongPixels] = {}
    of_scenes = [setting for setting in settings if setting.only == "scenes"]
    of_textures = [setting for setting in settings if setting.only != "scenes"]
    for case in track(cases, "hard cases"):
        if isinstance(case, Refusal):
            cells += [_refusal(case, dtype) for dtype in inputs]
        elif isinstance(case, CopiesCase):
            cells += copies_cells(case, of_scenes, pictures, inputs)
        elif isinstance(case, SpiralCase):
            cells += spiral_cells(case, of_textures, inputs, depths)
        elif isinstance(case, CompositeCase):
            cells += composite_cells(case, of_textures, pictures, inputs, depths)
        elif isinstance(case, MeshCase):
            cells += mesh_cells(case, of_textures, pictures, inputs, depths)
        else:
            cells += _pictures(case, of_textures, pictures, inputs, depths)
    model = HardCasesModel(
        machine=describe_machine(),
        threads=list(thread_counts()),
        cases=[CaseFacts(name=case.name, group=case.group, what=case.what) for case in cases],
        settings=[_facts(setting) for setting in settings],
        cells=cells,
        seconds=perf_counter() - began,
    )
    return HardRun(model, pictures)


def _facts(setting: Setting) -> SettingFacts:
    return SettingFacts(
        label=setting.label,
        renderer=setting.renderer,
        options=dict(setting.options),
        first_layer=setting.first_layer,
    )


def _refusal(case: Refusal, dtype: str) -> Cell:
    """A texture, frame or camera that must not come into being."""
    spot = Spot(case, "load", dtype)
    try:
        case.build(dtype)
    except IbrError as error:
        return plain_cell(spot, "pass", message=str(error))
    except Exception as error:
        told = f"{type(error).__name__}: {error}"
        return plain_cell(spot, "fail", ["raised something else than an IbrError"], message=told)
    return plain_cell(spot, "fail", ["was accepted without a word"])


def _pictures(
    case: Case,
    settings: Sequence[Setting],
    pictures: dict[tuple[str, str], WrongPixels],
    inputs: Sequence[str],
    depths: Sequence[int],
) -> list[Cell]:
    cells, built = [], case.build()
    exact = built.given_as("float64")
    for dtype in inputs:
        original = built.given_as(dtype)
        for bits in depths:
            posed = Posed(original.stored(bits), bits, original.step(bits), original)
            reason = _senseless(posed, exact)
            cell = partial(_picture, posed=posed, pictures=pictures)
            cells += cells_of_settings(case, settings, dtype, bits, reason, cell)
    return cells


def _senseless(posed: Posed, exact: Shot) -> str:
    """Return why this storage, or these arrays, make no case of their own; empty = they do."""
    if posed.bits != 32 and posed.step == 0.0:
        return ALIKE
    moved = float(np.linalg.norm(posed.shot.camera.center - exact.camera.center))
    if moved > 0.0 and not seen(posed.shot) and seen(exact):
        return f"float32 poses: the eye moves by {moved:.2g} units and sees nothing of the surface"
    camera = posed.shot.camera
    apart = float(np.abs(camera.R @ camera.R.T - np.eye(3)).max() * camera.K[0, 0])
    if apart > APART:
        return f"float32 rotations: rounded, this one and its inverse part by {apart:.1g} pixels at such a focal length"
    return ""


def _picture(spot: Spot, posed: Posed, setting: Setting, pictures: dict[tuple[str, str], WrongPixels]) -> Cell:
    case, kind, bits = spot.case, type(posed.shot.source).__name__, posed.bits
    assert isinstance(case, Case)
    if not isinstance(posed.shot.source, find_renderer(setting.renderer).accepts) or setting.only:
        return plain_cell(spot, "not applicable", message=f"does not take a {kind}")
    made = render_twice(spot, setting, posed.shot.source, posed.shot.camera)
    if isinstance(made, Cell):
        return made
    frame, same = made
    surface, truth, color = posed.one_layer if setting.first_layer else posed.all_layers
    errors, maps = measure([surface], truth, color, posed.shot.camera, frame)
    if maps.wrong.any() and bits == 32 and spot.input == "float64" and frame.depth is not None:
        pictures[case.name, setting.label] = WrongPixels(truth.depth, frame.depth, maps.wrong)
    meant = from_meant(posed, surface, truth, frame)
    limit = setting.limit_for(case.name)
    limits = hold_limits(limit, posed, surface, truth, case.colors_tie)
    failures = exceed(errors, meant, limits)
    if not same:
        failures.append("one thread and all threads gave different bytes")
    depth_bytes = posed.bits // 8 * count_samples(posed.shot.source)
    return Cell(
        case=case.name,
        setting=setting.label,
        input=spot.input,
        bits=bits,
        status="fail" if failures else "pass",
        failures=failures,
        message="",
        same_bytes=same,
        depth_bytes=depth_bytes,
        figures=figures_of(errors, meant),
        limits=limits,
    )
