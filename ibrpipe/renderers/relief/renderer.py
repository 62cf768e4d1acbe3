"""What the `relief` renderer does: height fields and relief-mapped meshes searched ray by ray. Source: policarpo2005.

The searches, the surface that they hit and the departures from the paper stand in ``docs/renderers/relief.md``.
"""

from __future__ import annotations

from dataclasses import dataclass
from time import perf_counter
from typing import Any

import numpy as np

from ibrpipe.core.relief import shade
from ibrpipe.errors import RendererError
from ibrpipe.renderers.frames import limited_threads, make_frame
from ibrpipe.renderers.relief.height_fields import Field, build_field
from ibrpipe.renderers.relief.meshes import MeshPart, build_mesh
from ibrpipe.renderers.relief.options import ReliefOptions
from ibrpipe.types import Array, Camera, Frame
from ibrpipe.types.relief_mesh import ReliefMesh
from ibrpipe.types.renderable import Renderable


@dataclass(frozen=True, eq=False)
class Scene:
    """All parts of a prepared source."""

    parts: tuple[Field | MeshPart, ...]

    @property
    def bytes(self) -> int:
        """Bytes held beyond the sources."""
        return sum(part.bytes for part in self.parts)


def prepare(sources: tuple[Renderable, ...]) -> Scene:
    """Build the pyramids of all sources."""
    return Scene(
        tuple(build_mesh(source) if isinstance(source, ReliefMesh) else build_field(source) for source in sources)
    )


def draw(scene: Scene, camera: Camera, outputs: tuple[str, ...], options: ReliefOptions) -> Frame:
    """Render one frame; see `ibrpipe.render`."""
    meshes = sum(isinstance(part, MeshPart) for part in scene.parts)
    if options.vertices is not None and meshes != 1:
        raise RendererError(f"vertices deform one relief mesh, the scene has {meshes}; render them one by one")
    began = perf_counter()
    shape = (camera.height, camera.width)
    depth = np.full(shape, np.inf, np.float32)
    shaded = bool({"color", "alpha"} & set(outputs))
    color, alpha = (np.zeros((*shape, 3), np.float32), np.zeros(shape, np.float32)) if shaded else (None, None)
    with limited_threads(options.threads):
        for whole in scene.parts:
            part = whole.level(whole.suited_level(camera) if options.level == "auto" else options.level)
            if isinstance(part, MeshPart):
                part.draw(camera, options, depth, color, alpha)
            else:
                _draw_field(part, camera, options, depth, color, alpha)
    stats: dict[str, Any] = {"rays": depth.size, "milliseconds": 1e3 * (perf_counter() - began)}
    if alpha is not None:
        stats["hits"] = int(np.count_nonzero(alpha))
    return make_frame(outputs, depth, color, alpha, stats)


def _draw_field(
    field: Field, camera: Camera, options: ReliefOptions, depth: Array, color: Array | None, alpha: Array | None
) -> None:
    before = depth.copy() if color is not None else depth
    hit_cells = np.empty((*depth.shape, 2) if color is not None else (0, 0, 2))
    field.search(camera, options, depth, hit_cells)
    if color is not None and alpha is not None:
        mine = depth < before
        color[mine], alpha[mine] = 0.0, 0.0
        shade.color_heights(mine, hit_cells, field.color, color, alpha)
