"""Cells of relief-mapped meshes: the polygons' own relief (``model="flat"``) and its shell, each against its oracle."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np

from ibrpipe.bench.cases.case import MeshCase, MeshShot
from ibrpipe.bench.hard_cases.frames import (
    ALIKE,
    Spot,
    WrongPixels,
    cells_of_settings,
    frame_bytes,
    plain_cell,
    thread_counts,
)
from ibrpipe.bench.hard_cases.posed import ULPS, exceed, figures_of, finite
from ibrpipe.bench.hard_cases.results import Cell, Limits
from ibrpipe.bench.oracles import meshes as oracle
from ibrpipe.bench.settings import Limit, Setting
from ibrpipe.bench.speed_error.measure import ASTRAY, DOUBTFUL, Errors, ends, ray_lengths
from ibrpipe.errors import IbrError
from ibrpipe.renderers.api import prepare, render
from ibrpipe.renderers.registry import find_renderer
from ibrpipe.types import Array, Frame
from ibrpipe.types.relief_mesh import ReliefMesh

#: a lamp for the second picture of every cell, which must hold no NaN
LAMP = (0.3, -0.4, 1.0, 0.0)


@dataclass(frozen=True, eq=False)
class PosedMesh:
    """A shot stored in some bits, with its exact answers for each model, shared by all settings."""

    shot: MeshShot
    source: ReliefMesh
    bits: int

    @cached_property
    def flat(self) -> oracle.Hits:
        """Exact hits below each polygon."""
        return oracle.cast_relief(self.source, oracle.relief_of(self.source), self.shot.camera, "flat")

    @cached_property
    def shell(self) -> oracle.Hits:
        """Exact hits in the shell of prisms."""
        return oracle.cast_relief(self.source, oracle.relief_of(self.source), self.shot.camera, "shell")


def mesh_cells(
    case: MeshCase,
    settings: Sequence[Setting],
    pictures: dict[tuple[str, str], WrongPixels],
    inputs: Sequence[str],
    depths: Sequence[int],
) -> list[Cell]:
    """Return the cells of one case; frames with wrong pixels go to `pictures`."""
    built, cells = case.build(), []
    for dtype in inputs:
        shot = built.given_as(dtype)
        for bits in depths:
            stored = oracle.stored(shot.source, shot.meant, bits)
            posed = PosedMesh(shot, stored, bits)
            alike = bits != 32 and np.array_equal(stored.height, shot.source.height)
            cell = partial(_cell, posed=posed, pictures=pictures)
            cells += cells_of_settings(case, settings, dtype, bits, ALIKE if alike else "", cell)
    return cells


def _cell(spot: Spot, posed: PosedMesh, setting: Setting, pictures: dict[tuple[str, str], WrongPixels]) -> Cell:
    if ReliefMesh not in find_renderer(setting.renderer).accepts:
        return plain_cell(spot, "not applicable", message="does not take a ReliefMesh")
    try:
        frame, same, lit = _render(posed, setting)
    except IbrError as error:
        return plain_cell(spot, "fail", ["refused a source that it says it takes"], message=str(error))
    except Exception as error:
        message = f"{type(error).__name__}: {error}"
        return plain_cell(spot, "fail", ["raised something else than an IbrError"], message=message)
    hits = posed.shell if setting.options.get("model") == "shell" else posed.flat
    errors, meant, wrong = _measure(posed, hits, frame, lit)
    if wrong.any() and (spot.input, spot.bits) == ("float64", 32) and frame.depth is not None:
        pictures[spot.case.name, setting.label] = WrongPixels(hits.truth.depth, frame.depth, wrong)
    limits = _limits(setting.limit_for(spot.case.name), posed, hits)
    failures = exceed(errors, meant, limits) + ([] if same else ["one thread and all threads gave different bytes"])
    return Cell(
        case=spot.case.name, setting=setting.label, input=spot.input, bits=posed.bits,
        status="fail" if failures else "pass", failures=failures,
        message="", same_bytes=same, depth_bytes=posed.bits // 8 * posed.source.height.size,
        figures=figures_of(errors, meant), limits=limits,
    )  # fmt: skip


def _render(posed: PosedMesh, setting: Setting) -> tuple[Frame, bool, Frame]:
    """Return the frame without light, whether thread counts agree, and a frame with light and shadows."""
    prepared, camera, options = prepare(posed.source, setting.renderer), posed.shot.camera, dict(setting.options)
    counts = thread_counts()
    plain = [render(prepared, camera, setting.renderer, threads=n, anisotropy=0, **options) for n in counts]
    lit = [render(prepared, camera, setting.renderer, threads=n, light=LAMP, **options) for n in counts]
    return plain[1], all(frame_bytes(one) == frame_bytes(other) for one, other in (plain, lit)), lit[1]


def _measure(
    posed: PosedMesh, hits: oracle.Hits, frame: Frame, lit: Frame
) -> tuple[Errors, tuple[float, float], Array]:
    """Return the errors, the distance from the surface before it was stored, and which pixels are wrong."""
    assert frame.depth is not None
    assert frame.color is not None
    assert lit.color is not None
    truth, texel, per_depth = hits.truth, hits.texel, ray_lengths(posed.shot.camera)
    got = frame.depth.astype(np.float64)
    nan = np.isnan(got) | ~np.isfinite(frame.color).all(axis=-1) | ~np.isfinite(lit.color).all(axis=-1)
    lost, extra = np.isinf(got) & np.isfinite(truth.latest), np.isfinite(got) & np.isinf(truth.earliest)
    both = np.isfinite(got) & np.isfinite(truth.earliest)
    with np.errstate(invalid="ignore"):
        beyond = np.fmax(truth.earliest - got, got - truth.latest) * per_depth / texel
        away = np.abs(got - truth.depth) * per_depth / texel
    astray, sure = both & (beyond > ASTRAY), truth.clear(DOUBTFUL * texel)
    clear = both & sure & np.isfinite(truth.depth)
    good, wrong = clear & ~astray, lost | extra | astray
    errors = Errors(
        pixels=got.size,
        hits=int(np.isfinite(truth.depth).sum()),
        doubtful=int((~sure).sum()),
        lost=int(lost.sum()),
        extra=int(extra.sum()),
        astray=int(astray.sum()),
        gross=int(wrong.sum()),
        nan=int(nan.sum()),
        **ends("texels", away[clear]),
        **ends("codes", 255.0 * np.abs(frame.color - _colors(posed.source, hits)).max(axis=-1)[good]),
        **dict.fromkeys(("shift", "shift_p99", "off", "off_p99"), np.nan),
        rmse=float(np.sqrt(np.mean(away[good] ** 2))) if good.any() else 0.0,
    )
    meant = ends("meant", _from_meant(posed, hits, got)[good])
    return errors, (meant["meant"], meant["meant_p99"]), wrong | nan


def _colors(source: ReliefMesh, hits: oracle.Hits) -> Array:
    picture = np.ones((1, 1, 3)) if source.color is None else source.color.astype(np.float64)
    return oracle.read(picture, source.edges == "wrap", hits.position[..., 0], hits.position[..., 1])


def _from_meant(posed: PosedMesh, hits: oracle.Hits, got: Array) -> Array:
    """(H, W) texels of depth from the shown point to the front before it was stored; NaN where that is not hit."""
    return _off(posed, hits, got, 1.0 - posed.shot.meant)


def _off(posed: PosedMesh, hits: oracle.Hits, depth: Array, front: Array) -> Array:
    """(H, W) texels from the rays' points at `depth` to a front (h, w), along it; NaN where the front is not hit."""
    wraps = posed.source.edges == "wrap"
    at = oracle.read(
        oracle.relief_of(posed.source).front[..., None], wraps, hits.position[..., 0], hits.position[..., 1]
    )
    with np.errstate(invalid="ignore"):
        u, v, z = np.moveaxis(hits.position + (depth - hits.truth.depth)[..., None] * hits.rate, -1, 0)
        off = np.abs(z - oracle.read(front.reshape(*posed.source.height.shape, 1), wraps, u, v)[..., 0])
        on_front = np.abs(hits.position[..., 2] - at[..., 0]) < 1e-9
    return np.where(on_front, off * posed.source.thickness / hits.texel, np.nan)


def _limits(limit: Limit, posed: PosedMesh, hits: oracle.Hits) -> Limits:
    """Return the limit with what float32 depth and the steps of stored heights add."""
    seen, thickness = np.isfinite(hits.truth.depth), posed.source.thickness
    rounding, stored, across = 0.0, 0.0, 0.0
    if seen.any():
        per_depth, texel = ray_lengths(posed.shot.camera)[seen], hits.texel[seen]
        unit = ULPS * np.spacing(hits.truth.depth.astype(np.float32)).astype(np.float64)
        rounding = float((unit[seen] * per_depth / texel).max())
        front = oracle.relief_of(posed.source).front
        ends = [_off(posed, hits, hits.truth.depth + sign * unit, front) for sign in (-1.0, 1.0)]
        across = float(np.nanmax(np.stack(ends), initial=0.0))  # slivers: the texture runs by within a unit of depth
        step = 0.5 / (2**posed.bits - 1) if posed.bits < 32 else float(np.spacing(np.float32(1.0)))
        stored = step * thickness / float(texel.min())
    return Limits(
        texels=finite(limit.texels + rounding),
        texels_p99=finite(limit.texels_p99 + rounding),
        shift_p99=None,
        wrong=finite(limit.wrong),
        gross=finite(limit.gross),
        codes_p99=finite(limit.codes_p99),
        meant=finite(limit.texels + max(rounding, across) + stored),
        reason=limit.reason,
    )
