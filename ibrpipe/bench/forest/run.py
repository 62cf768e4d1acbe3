"""Forests by the renderer `hierarchical` and by Embree with instances, timed in turn, at equal error."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from time import perf_counter, process_time

import numba
import numpy as np

from ibrpipe.bench.forest.flight import fly
from ibrpipe.bench.forest.peer import Peer
from ibrpipe.bench.forest.pictures import our_picture, over_sky
from ibrpipe.bench.forest.results import FlightRow, ForestModel, ForestRow
from ibrpipe.core.color import srgb_encode
from ibrpipe.engine.machine import describe_machine
from ibrpipe.errors import RendererError, ResourceError
from ibrpipe.progress import track
from ibrpipe.renderers.api import Prepared, prepare, render
from ibrpipe.renderers.hierarchical.coverage import make_slices
from ibrpipe.renderers.hierarchical.nodes import scene_nodes
from ibrpipe.renderers.hierarchical.prefiltering import Slicing
from ibrpipe.synthetic.instanced.forest import forest, forest_cameras
from ibrpipe.types import Array, Camera, Scene
from ibrpipe.types.prerendered import Prerendered, PrerenderedScene

#: samples of the peer along a side of a pixel: those that are timed, and those of the truth
SIDES, TRUTH = (1, 2, 4), 16
#: why errors are missing where nothing is compared
ALONE = "times alone"


@dataclass(frozen=True)
class Shot:
    """The least CPU and wall milliseconds of a picture, and the picture over the sky (H, W, 3)."""

    cpu: float
    wall: float
    picture: Array


def run_forest(
    trees: Sequence[int],
    views: Sequence[str],
    seed: int = 5,
    repeats: int = 5,
    size: tuple[int, int] = (640, 480),
    slicing: Slicing | None = None,
    frames: int = 0,
    alone: bool = False,
    pixel_error: float | None = None,
) -> ForestModel:
    """Measure forests of several sizes from several cameras, and flights of `frames` frames; see `ForestModel`.

    `alone`: only our times, without the peer and without errors. `pixel_error`: the renderer's option, for pictures
    (flights have it as usual).
    """
    options = {} if pixel_error is None else {"pixel_error": pixel_error}
    began = perf_counter()
    rows: list[ForestRow] = []
    flights: list[FlightRow] = []
    libraries: dict[tuple[str, ...], Prerendered] = {}
    for count in track(trees, "forests"):
        scene, cameras = forest(count, seed), forest_cameras(count, *size)
        library = _slices(forest(max(count, 50), seed), slicing or Slicing(), libraries)
        peer, note = (None, ALONE) if alone else _peer(scene)
        ours = prepare(PrerenderedScene(scene, library), "hierarchical")
        rows += [_row(count, view, cameras[view], ours, peer, note, repeats, options) for view in views]
        flights += [fly(count, frames, ours, peer, size)] if frames > 1 else []
    return ForestModel(
        machine=describe_machine(), width=size[0], height=size[1], seed=seed, library_bytes=library.bytes,
        prerender_seconds=float(library.info["seconds"]), rows=rows, flights=flights, seconds=perf_counter() - began,
    )  # fmt: skip


def _slices(scene: Scene, slicing: Slicing, made: dict[tuple[str, ...], Prerendered]) -> Prerendered:
    """The slices of a scene; forests of the same parts share them."""
    names = tuple(scene.parts)
    if names not in made:
        made[names] = make_slices(scene_nodes(scene), slicing)
    return made[names]


def _peer(scene: Scene) -> tuple[Peer | None, str]:
    try:
        return Peer(scene_nodes(scene), scene.lighting), ""
    except ResourceError as error:
        return None, f"no peer: {error}"


def _row(
    trees: int,
    view: str,
    camera: Camera,
    ours: Prepared,
    peer: Peer | None,
    note: str,
    repeats: int,
    options: Mapping[str, float],
) -> ForestRow:
    frame = render(ours, camera, "hierarchical", ("color", "alpha"), **options)
    stats = {name: int(frame.stats[name]) for name in ("parts", "slices", "triangles")}
    shots: dict[int, Shot] = {}
    for _ in range(repeats):
        _keep(shots, 0, our_shot(ours, camera, **options))
        if peer is not None:
            for side in SIDES:
                _keep(shots, side, peer_shot(peer, camera, side))
    mine = shots.pop(0)
    truth = None
    if peer is not None:
        truth = peer_shot(peer, camera, TRUTH).picture
    elif note != ALONE:
        truth, told = _polygons(ours, camera)
        note += f"; {told}"
    own = None if truth is None else psnr(mine.picture, truth)
    scores = {} if truth is None else {n * n: (shot.cpu, psnr(shot.picture, truth)) for n, shot in shots.items()}
    equal = None if own is None else equal_time(list(scores.values()), own)
    return ForestRow(
        trees=trees, view=view, ours_ms=mine.cpu, ours_wall_ms=mine.wall, ours_psnr=own,
        peer={str(samples): score for samples, score in scores.items()}, equal_ms=equal,
        ratio=None if equal is None else equal / mine.cpu, note=note, **stats,
    )  # fmt: skip


def _polygons(ours: Prepared, camera: Camera) -> tuple[Array | None, str]:
    """The truth where there is no peer, our polygons at 16 samples a pixel, and what is said of it; None = too many."""
    try:
        return over_sky(*our_picture(ours, camera, "polygons")), "PSNR is against our polygons at 16 samples a pixel"
    except RendererError as error:
        return None, f"no errors: {error}"


def _keep(shots: dict[int, Shot], name: int, shot: Shot) -> None:
    before = shots.get(name, shot)
    shots[name] = Shot(min(before.cpu, shot.cpu), min(before.wall, shot.wall), shot.picture)


def our_shot(ours: Prepared, camera: Camera, **options: float) -> Shot:
    """Draw once with the renderer `hierarchical`."""
    wall, cpu = perf_counter(), process_time()
    color, alpha = our_picture(ours, camera, "slices", **options)
    cpu, wall = process_time() - cpu, perf_counter() - wall
    return Shot(1e3 * cpu / numba.get_num_threads(), 1e3 * wall, over_sky(color, alpha))


def peer_shot(peer: Peer, camera: Camera, side: int) -> Shot:
    """Draw once with the peer, side x side samples a pixel."""
    wall = perf_counter()
    picture, cpu = peer.render(camera, side)
    wall = perf_counter() - wall
    return Shot(1e3 * cpu / numba.get_num_threads(), 1e3 * wall, over_sky(picture[..., :3], picture[..., 3]))


def psnr(one: Array, other: Array) -> float:
    """PSNR of linear pictures, as sRGB between 0 and 1, not rounded to codes, dB."""
    a, b = (srgb_encode(each.astype(np.float64)) for each in (one, other))
    return -10.0 * math.log10(max(1e-12, float(np.mean((a - b) ** 2))))


def equal_time(scores: Sequence[tuple[float, float]], wanted: float) -> float | None:
    """Return the time at which a method reaches the PSNR `wanted`, None without scores.

    Between two of its (milliseconds, PSNR), ascending, the logarithm of time is linear in PSNR; beyond them the nearest
    two are followed on.
    """
    if len(scores) < 2:
        return None
    pairs = list(pairwise(scores))
    (t0, p0), (t1, p1) = next((pair for pair in pairs if wanted <= pair[1][1]), pairs[-1])
    share = (wanted - p0) / (p1 - p0)
    return math.exp((1.0 - share) * math.log(t0) + share * math.log(t1))
