"""Table 2 of schaufler1999 again: torus and globe (6 maps each) and a mesh (16 maps) at growing sizes.

Maps and picture are of the same size, as in the paper; the growth per doubling tells O(n^2), which is 4, from O(n^3).
"""

from __future__ import annotations

from collections.abc import Sequence
from statistics import median
from time import perf_counter
from typing import Any

import numpy as np

from ibrpipe.renderers.api import prepare, render
from ibrpipe.stages.depth_images import Frustum, cube_frusta, depth_images_asset, greedy_frusta
from ibrpipe.types import Camera, Mesh

#: seconds of the paper, 250 MHz R10000
PAPER = {
    "torus": {128: 0.0503, 256: 0.2013, 512: 0.7752},
    "globe": {128: 0.0523, 256: 0.2911, 512: 0.8362},
    "dragon": {128: 0.0842, 256: 0.3218, 512: 1.2276},
}


def torus(steps: int = 96) -> Mesh:
    """Return a torus of radii 1 and 0.4."""
    a, b = np.meshgrid(np.arange(2 * steps) * np.pi / steps, np.arange(steps) * 2 * np.pi / steps, indexing="ij")
    ring = 1.0 + 0.4 * np.cos(b)
    vertices = np.stack([ring * np.cos(a), ring * np.sin(a), 0.4 * np.sin(b)], axis=-1)
    return Mesh(vertices.reshape(-1, 3), _grid_faces(2 * steps, steps))


def globe(steps: int = 128) -> Mesh:
    """Return a ball of radius 1 with continents."""
    a, b = np.meshgrid(np.arange(2 * steps) * np.pi / steps, (np.arange(steps) + 0.5) * np.pi / steps, indexing="ij")
    way = np.stack([np.sin(b) * np.cos(a), np.sin(b) * np.sin(a), np.cos(b)], axis=-1)
    x, y, z = np.moveaxis(way, -1, 0)
    land = np.sin(3 * x + 1) * np.sin(4 * y) + np.sin(5 * z + 2 * x) + 0.3 * np.sin(17 * x) * np.sin(19 * y + 3 * z)
    vertices = way * (1.0 + 0.04 * np.maximum(land, 0.0))[..., None]
    return Mesh(vertices.reshape(-1, 3), _grid_faces(2 * steps, steps, closed=False))


def _grid_faces(columns: int, rows: int, closed: bool = True) -> Any:
    """Faces of a grid that is closed along its columns (and rows), counter-clockwise from outside."""
    i, j = np.meshgrid(np.arange(columns), np.arange(rows if closed else rows - 1), indexing="ij")
    a, b = i * rows + j, (i + 1) % columns * rows + j
    c, d = i * rows + (j + 1) % rows, (i + 1) % columns * rows + (j + 1) % rows
    two = [np.stack(three, axis=-1).reshape(-1, 3) for three in ((a, b, d), (a, d, c))]
    faces = np.concatenate(two)
    return (faces if closed else faces[:, ::-1]).astype(np.int32)


def run_table(
    sizes: Sequence[int] = (128, 256, 512),
    dragon: Mesh | None = None,
    searches: Sequence[str] = ("nearest", "exact"),
    repeats: int = 5,
) -> list[dict[str, Any]]:
    """Measure every model at every size.

    Returns
    -------
    list of dict
        ``model``, ``maps``, ``search``, ``size``, ``seconds`` (median), ``growth`` (over the size before, per
        doubling), ``covered`` (share of the picture) and ``paper`` (seconds, None where the paper has none).
    """
    models: list[tuple[str, Mesh, Sequence[Frustum]]] = []
    for name, mesh in (("torus", torus()), ("globe", globe())):
        models.append((name, mesh, cube_frusta(mesh)))
    if dragon is not None:
        models.append(("dragon", dragon, greedy_frusta(dragon, 16)[0]))
    rows: list[dict[str, Any]] = []
    for name, mesh, frusta in models:
        for search in searches:
            rows += _measure(name, mesh, frusta, search, sizes, repeats)
    return rows


def _measure(
    name: str, mesh: Mesh, frusta: Sequence[Frustum], search: str, sizes: Sequence[int], repeats: int
) -> list[dict[str, Any]]:
    rows: list[dict[str, Any]] = []
    middle = 0.5 * (mesh.vertices.min(axis=0) + mesh.vertices.max(axis=0))
    radius = float(np.linalg.norm(mesh.vertices - middle, axis=1).max())
    for size in sizes:
        prepared = prepare(depth_images_asset(mesh, frusta, size, name), "epipolar")
        camera = Camera.look_at(
            middle + radius * np.array([1.9, -1.6, 1.2]), middle, fov_y_deg=44, width=size, height=size
        )
        frame = render(prepared, camera, "epipolar", search=search)
        seconds = []
        for _ in range(repeats):
            began = perf_counter()
            render(prepared, camera, "epipolar", search=search)
            seconds.append(perf_counter() - began)
        here = {"model": name, "maps": len(frusta), "search": search, "size": size, "seconds": median(seconds)}
        doublings = np.log2(size / rows[-1]["size"]) if rows else 0.0
        here["growth"] = (here["seconds"] / rows[-1]["seconds"]) ** (1 / doublings) if rows else None
        here["covered"] = float(np.mean([] if frame.depth is None else np.isfinite(frame.depth)))
        here["paper"] = PAPER.get(name, {}).get(size)
        rows.append(here)
    return rows
