"""Objects as one relief-mapped rectangle with two depths, and frames of relief-mapped meshes along a camera path."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ibrpipe.embree import Hits, MeshCaster
from ibrpipe.errors import ValueRangeError
from ibrpipe.io.surfaces.materials import write_packed
from ibrpipe.modelling.mesh_colors import ColorSampler
from ibrpipe.picture_files import write_png
from ibrpipe.types import Array, Mesh
from ibrpipe.types.mesh import MeshColors
from ibrpipe.types.relief_mesh import ReliefMesh

#: side -> axis looked along, its sign, then the world directions of the picture's right and down
SIDES = {
    "+x": ((1, 0, 0), (0, 0, -1), (0, -1, 0)),
    "-x": ((-1, 0, 0), (0, 0, 1), (0, -1, 0)),
    "+y": ((0, 1, 0), (1, 0, 0), (0, 0, 1)),
    "-y": ((0, -1, 0), (1, 0, 0), (0, 0, -1)),
    "+z": ((0, 0, 1), (1, 0, 0), (0, -1, 0)),
    "-z": ((0, 0, -1), (-1, 0, 0), (0, -1, 0)),
}
#: empty border of the rectangle, in texels
RIM = 2


def dual_relief_from_mesh(
    mesh: Mesh, side: str = "+z", texels: int = 512, colors: MeshColors | None = None
) -> ReliefMesh:
    """Sample front and back of a mesh orthographically onto one rectangle before it (policarpo2005, sec. 4).

    Parameters
    ----------
    mesh : Mesh
        Closed, or nothing is known of its back.
    side : {"+x", "-x", "+y", "-y", "+z", "-z"}
        Side that it is seen from.
    texels : int
        Along the longer edge of the rectangle.
    colors : MeshColors, optional
        Of the mesh's faces.

    Returns
    -------
    ReliefMesh
        Two triangles; `height` is the nearest surface, `back` the farthest, `normal` and `color` those of the nearest
        (one texture has one colour: the back shows the front's). No colour where the mesh brings none.
    """
    if side not in SIDES:
        raise ValueRangeError(f"side is {side!r}; choose among {', '.join(SIDES)}")
    toward, right, down = (np.array(each, np.float64) for each in SIDES[side])
    spans = [(mesh.vertices @ axis) for axis in (right, down, toward)]
    (u0, u1), (v0, v1), (d0, d1) = ((span.min(), span.max()) for span in spans)
    texel = max(u1 - u0, v1 - v0) / max(texels - 2 * RIM, 1)
    if not texel > 0:
        raise ValueRangeError(f"the mesh has no extent seen from {side}; choose another side")
    columns, rows = (max(2 * RIM + 1, int(np.ceil(each / texel - 1e-9)) + 2 * RIM) for each in (u1 - u0, v1 - v0))
    u0, v0 = 0.5 * (u0 + u1) - 0.5 * columns * texel, 0.5 * (v0 + v1) - 0.5 * rows * texel
    thickness = max(d1 - d0, 1e-6 * texel) * 1.002
    top = 0.5 * (d0 + d1) + 0.5 * thickness
    y, x = np.mgrid[:rows, :columns] + 0.5
    starts = (u0 + x[..., None] * texel) * right + (v0 + y[..., None] * texel) * down + (top + texel) * toward
    directions = np.broadcast_to(-toward, starts.shape).reshape(-1, 3)
    caster = MeshCaster(mesh)
    ray, hits = caster.cast_all(starts.reshape(-1, 3), directions)
    color = None if colors is None else np.zeros((rows * columns, 3), np.float32)
    height, back = np.zeros(rows * columns, np.float32), np.ones(rows * columns, np.float32)
    if len(ray):
        first = np.r_[True, ray[1:] != ray[:-1]]
        last = np.r_[first[1:], True]
        height[ray[first]] = np.clip(1.0 - (hits.t[first] - texel) / thickness, 0.0, 1.0)
        back[ray[last]] = np.clip(1.0 - (hits.t[last] - texel) / thickness, 0.0, 1.0)
        normal = _front_normals(caster, ray[first], hits, first, (right, down, toward), rows * columns)
        if colors is not None and color is not None:
            rays, across, along = (
                np.tile(each, (int(first.sum()), 1)) for each in (-toward, texel * right, texel * down)
            )
            color[ray[first]] = ColorSampler(mesh, colors).at(hits.face[first], hits.uv[first], rays, (across, along))
    corner = u0 * right + v0 * down + top * toward
    across, along = columns * texel * right, rows * texel * down
    corners = np.stack([corner + along, corner + along + across, corner + across, corner])
    uv = np.array([[[0, 1], [1, 1], [1, 0]], [[0, 1], [1, 0], [0, 0]]], np.float64)
    return ReliefMesh(
        Mesh(corners, np.array([[0, 1, 2], [0, 2, 3]])),
        uv,
        height.reshape(rows, columns),
        thickness,
        back=back.reshape(rows, columns),
        color=None if color is None else color.reshape(rows, columns, 3),
        normal=normal.reshape(rows, columns, 3) if len(ray) else None,
        edges="cut",
    )


def _front_normals(
    caster: MeshCaster, texels: Array, hits: Hits, first: Array, axes: tuple[Array, Array, Array], count: int
) -> Array:
    """(count, 3) unit normals along u, along v and toward the viewer; straight up where nothing is hit."""
    found = caster.smooth_normals(hits.face[first], hits.uv[first])
    local = np.stack([found @ axis for axis in axes], axis=1)
    local = np.where(local[:, 2:] < 0, -local, local)
    normal = np.tile(np.array([0, 0, 1], np.float32), (count, 1))
    normal[texels] = local / np.maximum(np.linalg.norm(local, axis=1, keepdims=True), 1e-12)
    return normal


def write_relief_quad(source: ReliefMesh, out: Path) -> None:
    """Write a relief on two triangles as ``quad.obj`` and ``packed.png``; colours as ``color.png`` in a material."""
    out.mkdir(parents=True, exist_ok=True)
    write_packed(source, out / "packed.png")
    lines = []
    if source.color is not None:
        write_png(out / "color.png", source.color)
        (out / "quad.mtl").write_text("newmtl relief\nKd 1 1 1\nmap_Kd color.png\n", encoding="utf-8")
        lines = ["mtllib quad.mtl", "usemtl relief"]
    lines += [f"# {source.thickness!r} units from the front of the relief to its back"]
    lines += ["v {!r} {!r} {!r}".format(*(float(each) for each in place)) for place in source.mesh.vertices]
    lines += [f"vt {float(u)!r} {float(1.0 - v)!r}" for u, v in source.uv.reshape(-1, 2)]
    for f, face in enumerate(source.mesh.faces):
        lines.append("f " + " ".join(f"{vertex + 1}/{3 * f + c + 1}" for c, vertex in enumerate(face)))
    (out / "quad.obj").write_text("\n".join(lines) + "\n", encoding="utf-8")
