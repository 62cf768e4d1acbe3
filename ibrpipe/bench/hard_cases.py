"""Every hard case with every renderer, against the exact answer, with one thread and with all."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from time import perf_counter

import numba

from ibrpipe.bench.cases import Case, MeshCase, Refusal, SpiralCase
from ibrpipe.bench.cases.case import AnyCase
from ibrpipe.bench.hard_frames import WrongPixels, plain_cell, render_twice
from ibrpipe.bench.hard_meshes import mesh_cells
from ibrpipe.bench.hard_posed import Posed, count_samples, exceed, figures_of, from_meant, hold_limits
from ibrpipe.bench.hard_results import CaseFacts, Cell, HardCasesModel, SettingFacts
from ibrpipe.bench.hard_spirals import spiral_cells
from ibrpipe.bench.measure import measure
from ibrpipe.bench.settings import Setting
from ibrpipe.errors import IbrError
from ibrpipe.progress import track
from ibrpipe.renderers.registry import find_renderer
from ibrpipe.stages.machine import describe_machine


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


def run_hard_cases(cases: Sequence[AnyCase], settings: Sequence[Setting]) -> HardRun:
    """Render every case with every setting and hold the errors to their limits."""
    began, cells = perf_counter(), []
    pictures: dict[tuple[str, str], WrongPixels] = {}
    for case in track(cases, "hard cases"):
        if isinstance(case, Refusal):
            cells.append(_refusal(case))
        elif isinstance(case, SpiralCase):
            cells += spiral_cells(case, settings)
        elif isinstance(case, MeshCase):
            cells += mesh_cells(case, settings, pictures)
        else:
            cells += _pictures(case, settings, pictures)
    model = HardCasesModel(
        machine=describe_machine(),
        threads=numba.config.NUMBA_NUM_THREADS,
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


def _refusal(case: Refusal) -> Cell:
    """A texture, frame or camera that must not come into being."""
    try:
        case.build()
    except IbrError as error:
        return plain_cell(case, "load", 32, "pass", message=str(error))
    except Exception as error:
        told = f"{type(error).__name__}: {error}"
        return plain_cell(case, "load", 32, "fail", ["raised something else than an IbrError"], message=told)
    return plain_cell(case, "load", 32, "fail", ["was accepted without a word"])


def _pictures(case: Case, settings: Sequence[Setting], pictures: dict[tuple[str, str], WrongPixels]) -> list[Cell]:
    cells = []
    original = case.build()
    for bits in case.bits:
        posed = Posed(original.stored(bits), bits, original.step(bits), original)
        cells += [_picture(case, posed, setting, pictures) for setting in settings]
    return cells


def _picture(case: Case, posed: Posed, setting: Setting, pictures: dict[tuple[str, str], WrongPixels]) -> Cell:
    kind, bits = type(posed.shot.source).__name__, posed.bits
    if kind not in find_renderer(setting.renderer).accepts or setting.meshes:
        return plain_cell(case, setting.label, bits, "not applicable", message=f"does not take a {kind}")
    made = render_twice(case, setting, bits, posed.shot.source, posed.shot.camera)
    if isinstance(made, Cell):
        return made
    frame, same = made
    surface, truth, color = posed.one_layer if setting.first_layer else posed.all_layers
    errors, maps = measure([surface], truth, color, posed.shot.camera, frame)
    if maps.wrong.any() and bits == 32 and frame.depth is not None:
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
        bits=bits,
        status="fail" if failures else "pass",
        failures=failures,
        message="",
        same_bytes=same,
        depth_bytes=depth_bytes,
        figures=figures_of(errors, meant),
        limits=limits,
    )
