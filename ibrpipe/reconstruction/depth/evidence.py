"""What depth maps say of the vertices of a mesh."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ibrpipe.core.reconstruction.tsdf import observe
from ibrpipe.progress import Step
from ibrpipe.reconstruction.depth.map_store import MapStore, pack
from ibrpipe.types import Array, Mesh

OBSERVATIONS = Step("observations", 0.1)


@dataclass(frozen=True, eq=False)
class Evidence:
    """What the depth maps say of the vertices of a mesh.

    Attributes
    ----------
    observations : (V,) int32
        Depth maps that show a surface there.
    through : (V,) int32
        Depth maps that look through it.
    confidence : (V,) float32
        0 where nothing was seen; else the best map's confidence, less where maps look through or only two agree.
    """

    observations: Array
    through: Array
    confidence: Array


def evidence(mesh: Mesh, maps: MapStore, tolerance: float, facing: Array | None = None) -> Evidence:
    """Ask all maps about the vertices.

    Parameters
    ----------
    mesh : Mesh
    maps : MapStore
    tolerance : float
        Scene units along the camera's axis.
    facing : (V, 3) float64, optional
        Only maps on this side of a vertex are asked; 0 0 0 = those on any side.
    """
    count = len(mesh.vertices)
    seen, through = np.zeros(count, np.int32), np.zeros(count, np.int32)
    best, slack = np.zeros(count, np.float32), np.full(count, tolerance, np.float64)
    for each in OBSERVATIONS.track(maps, len(maps)):
        p, away = pack([each]), np.zeros(count, bool)
        if facing is not None:
            away = ((each.camera.center - mesh.vertices) * facing).sum(axis=1) < 0
        kept = seen[away], through[away], best[away]
        observe(mesh.vertices, p.depth, p.confidence, p.starts, p.sizes, p.projection, slack, seen, through, best)
        seen[away], through[away], best[away] = kept
    agreed = seen / np.maximum(seen + through, 1)
    return Evidence(seen, through, (best * agreed * (1 - 0.5 ** np.maximum(seen, 0))).astype(np.float32))
