"""Table 2 of schaufler1999 again: torus and globe (6 maps each) and a mesh (16 maps) at growing sizes.

Maps and picture are of the same size, as in the paper; the growth per doubling tells O(n^2), which is 4, from O(n^3).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from time import perf_counter
from typing import Any

import numpy as np

from ibrpipe.bench.sizes.results import Skipped, Table2Model, Table2Row
from ibrpipe.core.color import srgb_encode
from ibrpipe.engine.machine import describe_machine
from ibrpipe.evaluation.timing import interleave
from ibrpipe.modelling.depth_images import depth_images_asset
from ibrpipe.modelling.frusta import Frustum, central_frusta, cube_frusta, greedy_frusta
from ibrpipe.progress import track
from ibrpipe.renderers.api import prepare, render
from ibrpipe.types import Array, Camera, Mesh

#: seconds of the paper, 250 MHz R10000
PAPER = {
    "torus": {128: 0.0503, 256: 0.2013, 512: 0.7752},
    "globe": {128: 0.0523, 256: 0.2911, 512: 0.8362},
    "dragon": {128: 0.0842, 256: 0.3218, 512: 1.2276},
}


@dataclass
class Table2Run:
    """What a run found.

    Attributes
    ----------
    rows : list of Table2Row
    pictures : dict of (model, search) to (H, W, 3) float
        sRGB, of the greatest size.
    model : Table2Model
    """

    rows: list[Table2Row] = field(default_factory=list)
    pictures: dict[tuple[str, str], Array] = field(default_factory=dict)
    model: Table2Model | None = None


def torus(steps: int = 96) -> Mesh:
    """Return a torus of radii 1 and 0.4."""
    a, b = np.meshgrid(np.arange(2 * steps) * np.pi / steps, np.arange(steps) * 2 * np.pi / steps, indexing="ij")
    ring = 1.0 + 0.4 * np.cos(b)
    vertices = np.stack([ring * np.cos(a), ring * np.sin(a), 0.4 * np.sin(b)], axis=-1)
    return Mesh(vertices.reshape(-1, 3), _grid_faces(2 * steps, steps))


def globe(steps: int = 128) -> Mesh:
    """Return a ball of radius 1 with continents."""
    a, b = np.meshgrid(np.arange(2 * steps) * np.pi / steps, (np.arange(steps) + 0.5) * np.pi / steps, indexing="ij")
    direction = np.stack([np.sin(b) * np.cos(a), np.sin(b) * np.sin(a), np.cos(b)], axis=-1)
    x, y, z = np.moveaxis(direction, -1, 0)
    land = np.sin(3 * x + 1) * np.sin(4 * y) + np.sin(5 * z + 2 * x) + 0.3 * np.sin(17 * x) * np.sin(19 * y + 3 * z)
    vertices = direction * (1.0 + 0.04 * np.maximum(land, 0.0))[..., None]
    return Mesh(vertices.reshape(-1, 3), _grid_faces(2 * steps, steps, closed=False))


def _grid_faces(columns: int, rows: int, closed: bool = True) -> Any:
    """Faces of a grid that is closed along its columns (and rows), counter-clockwise from outside."""
    i, j = np.meshgrid(np.arange(columns), np.arange(rows if closed else rows - 1), indexing="ij")
    a, b = i * rows + j, (i + 1) % columns * rows + j
    c, d = i * rows + (j + 1) % rows, (i + 1) % columns * rows + (j + 1) % rows
    two = [np.stack(three, axis=-1).reshape(-1, 3) for three in ((a, b, d), (a, d, c))]
    faces = np.concatenate(two)
    return (faces if closed else faces[:, ::-1]).astype(np.int32)


def run_table2(
    sizes: Sequence[int] = (128, 256, 512),
    dragon: Mesh | None = None,
    searches: Sequence[str] = ("nearest", "exact"),
    repeats: int = 5,
) -> Table2Run:
    """Measure every model at every size.

    Parameters
    ----------
    sizes : sequence of int
        Texels of the maps and pixels of the picture along a side, ascending.
    dragon : Mesh, optional
        The third model; without it, it is left out.
    searches : sequence of str
        Searches of renderer ``epipolar``.
    repeats : int
        Timed frames, of which the median counts.
    """
    began = perf_counter()
    models: list[tuple[str, Mesh, Sequence[Frustum]]] = []
    models.append(("torus", torus(), cube_frusta(torus())))
    models.append(("globe", globe(), central_frusta(globe())))  # displaced from its centre outward, as in the paper
    if dragon is not None:
        models.append(("dragon", dragon, greedy_frusta(dragon, 16)[0]))
    run = Table2Run()
    for (name, mesh, frusta), size in track([(model, size) for model in models for size in sizes], "table 2"):
        run.rows += _measure(name, mesh, frusta, searches, size, repeats, run)
    run.rows.sort(key=lambda row: ([name for name, *_ in models].index(row.model), searches.index(row.search)))
    skipped = [] if dragon is not None else [Skipped(model="dragon", reason="no mesh was given; name one with --mesh")]
    run.model = Table2Model(machine=describe_machine(), rows=run.rows, skipped=skipped, seconds=perf_counter() - began)
    return run


def _measure(
    name: str, mesh: Mesh, frusta: Sequence[Frustum], searches: Sequence[str], size: int, repeats: int, run: Table2Run
) -> list[Table2Row]:
    """Time all searches on one model at one size, in turns."""
    middle = 0.5 * (mesh.vertices.min(axis=0) + mesh.vertices.max(axis=0))
    radius = float(np.linalg.norm(mesh.vertices - middle, axis=1).max())
    prepared = prepare(depth_images_asset(mesh, frusta, size, name), "epipolar")
    eye = middle + radius * np.array([1.9, -1.6, 1.2])
    camera = Camera.look_at(eye, middle, fov_y_deg=44, width=size, height=size)
    draws = {search: partial(render, prepared, camera, "epipolar", search=search) for search in searches}
    frames = {search: draw() for search, draw in draws.items()}
    times = interleave(draws, repeats, np.inf)
    rows = []
    for search, frame in frames.items():
        assert frame.depth is not None
        assert frame.color is not None
        before = [row for row in run.rows if (row.model, row.search) == (name, search)]
        taken = times[search].median
        factor = (taken / before[-1].milliseconds) ** (1 / np.log2(size / before[-1].size)) if before else None
        covered = float(np.mean(np.isfinite(frame.depth)))
        paper = PAPER.get(name, {}).get(size)
        rows.append(
            Table2Row(
                model=name, maps=len(frusta), search=search, size=size, milliseconds=taken, growth=factor,
                covered=covered, paper=1e3 * paper if paper else None,
            )
        )  # fmt: skip
        run.pictures[name, search] = srgb_encode(np.nan_to_num(frame.color).astype(np.float64).clip(0, 1))
    return rows
