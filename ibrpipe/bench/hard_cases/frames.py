"""Frames of a setting with one thread and with all threads, or the cell that tells what went wrong."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numba

from ibrpipe.bench.cases.case import AnyCase
from ibrpipe.bench.hard_cases.results import Cell
from ibrpipe.bench.settings import Setting
from ibrpipe.errors import IbrError
from ibrpipe.renderers.api import prepare, render
from ibrpipe.renderers.registry import find_renderer
from ibrpipe.types import Array, Camera, Frame
from ibrpipe.types.prerendered import PrerenderedScene
from ibrpipe.types.renderable import GridSource

#: what a cell draws
Drawn: TypeAlias = GridSource | Sequence[GridSource] | PrerenderedScene
#: why fewer bits make no case of their own
ALIKE = "all depths are the same, or there is none: fewer bits store them alike"


@dataclass(frozen=True, eq=False)
class WrongPixels:
    """A frame with wrong pixels, to be shown: exact depth, rendered depth, and where they differ; all (H, W)."""

    exact: Array
    rendered: Array
    wrong: Array


@dataclass(frozen=True)
class Spot:
    """Where a cell stands in the table: its case, its setting, the type of arrays given, the bits of stored depth."""

    case: AnyCase
    setting: str
    input: str = "float64"
    bits: int = 32


def render_twice(spot: Spot, setting: Setting, source: Drawn, camera: Camera) -> tuple[Frame, bool] | Cell:
    """Return the frame, and whether one thread and all threads gave the same bytes; or the cell of a failure."""
    try:
        draw = draw_with(setting, source, camera)
        one, many = (draw(threads) for threads in thread_counts())
    except IbrError as error:
        status = "refused" if setting.refuses else "fail"
        told = [] if setting.refuses else ["refused a source that it says it takes"]
        return plain_cell(spot, status, told, message=str(error))
    except Exception as error:
        told_as = f"{type(error).__name__}: {error}"
        return plain_cell(spot, "fail", ["raised something else than an IbrError"], message=told_as)
    return many, frame_bytes(one) == frame_bytes(many)


def thread_counts() -> tuple[int, int]:
    """Return one, and all that Numba has."""
    return 1, int(numba.config.NUMBA_NUM_THREADS)


def draw_with(setting: Setting, source: Drawn, camera: Camera) -> Callable[[int], Frame]:
    """Return a function from a number of threads to the frame."""
    prepared = prepare(source, setting.renderer)
    takes_threads = "threads" in find_renderer(setting.renderer).Options.model_fields

    def draw(threads: int) -> Frame:
        if takes_threads:
            return render(prepared, camera, setting.renderer, threads=threads, **setting.options)
        before = numba.get_num_threads()
        numba.set_num_threads(threads)
        try:
            return render(prepared, camera, setting.renderer, **setting.options)
        finally:
            numba.set_num_threads(before)

    return draw


def frame_bytes(frame: Frame) -> bytes:
    """Return all bytes of a frame."""
    return b"".join(part.tobytes() for part in (frame.color, frame.depth, frame.alpha) if part is not None)


def plain_cell(spot: Spot, status: str, failures: Sequence[str] = (), message: str = "") -> Cell:
    """Return a cell without figures."""
    return Cell.model_validate(
        {
            "case": spot.case.name, "setting": spot.setting, "input": spot.input, "bits": spot.bits, "status": status,
            "failures": list(failures), "message": message, "same_bytes": None, "depth_bytes": None, "figures": None,
            "limits": None,
        }
    )  # fmt: skip


def cells_of_settings(
    case: AnyCase, settings: Sequence[Setting], dtype: str, bits: int, senseless: str, make: Callable[..., Cell]
) -> list[Cell]:
    """Return a cell for each setting: of `make(spot=, setting=)`, or the reason why the case is `senseless`."""
    cells = []
    for setting in settings:
        spot = Spot(case, setting.label, dtype, bits)
        if senseless:
            cells.append(plain_cell(spot, "not applicable", message=senseless))
        else:
            cells.append(make(spot=spot, setting=setting))
    return cells
