"""Makers of relief textures: from images, from an asset's first layers, from a mesh's sides, from range data.

Source: oliveira2000, sec. 4 (modelling), 4.1 (six faces of an object's box) and 4.4 (range data and photos on planes
that the user places). On disk a relief texture is an asset with one sample per texel, its frame's f into the surface.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ibrpipe.embree import MeshCaster
from ibrpipe.errors import RendererError, ShapeError, ValueRangeError
from ibrpipe.modelling.mesh_colors import ColorSampler, Painter, clay, painter_of
from ibrpipe.types import (
    Array,
    Asset,
    DepthImage,
    LayeredDepthImage,
    Mesh,
    ParallelFrame,
    ReliefTexture,
    Texture,
)
from ibrpipe.types.layers import layers_of_relief, relief_normals
from ibrpipe.types.mesh import MeshColors

#: side of a mesh -> axis that is looked along, its sign, and the axes of columns and rows (rows go down the picture)
SIDES = {
    "+x": (0, 1.0, 1, 2),
    "-x": (0, -1.0, 1, 2),
    "+y": (1, 1.0, 0, 2),
    "-y": (1, -1.0, 0, 2),
    "+z": (2, 1.0, 0, 1),
    "-z": (2, -1.0, 0, 1),
}
#: texels of height between neighbours above which the renderers part the samples of an asset
PARTED = 4.0
#: neighbours in a depth image are one surface while the greater depth is below this multiple of the lesser
SAME_SURFACE = 1.05


def relief_from_images(
    height: Array, color: Array | None = None, size: tuple[float, float] = (1.0, 1.0)
) -> ReliefTexture:
    """Lay a height map and its colours on a rectangle round the origin: columns along +x, rows along -y, heights +z.

    Parameters
    ----------
    height : (H, W) float
        Scene units; NaN = transparent.
    color : (H, W, 3) float, linear, optional
        Clay, shaded by a fixed light, unless given.
    size : (width, height)
        Size of the rectangle, scene units.
    """
    rows, columns = np.shape(height)
    width, tall = size
    if not (width > 0 and tall > 0):
        raise ValueRangeError(f"the size is {width} x {tall}; both sides must be positive scene units")
    a, b, f = np.diag([width / columns, -tall / rows, 1.0])
    frame = ParallelFrame(np.array([-0.5 * width, 0.5 * tall, 0.0]), a, b, f)
    if color is None:
        bare = ReliefTexture(frame, np.zeros((rows, columns, 3)), height)
        color = clay(np.nan_to_num(relief_normals(bare)))
    return ReliefTexture(frame, color, height)


def steep_share(relief: ReliefTexture) -> float:
    """Share of neighbouring texels whose heights differ by more than an asset joins (`PARTED` texels)."""
    texel = max(np.linalg.norm(relief.frame.a), np.linalg.norm(relief.frame.b))
    steps = [np.abs(np.diff(relief.height, axis=axis)).ravel() for axis in (0, 1)]
    every = np.concatenate(steps)
    return float((every > PARTED * texel).mean()) if every.size else 0.0


def relief_from_layers(layers: LayeredDepthImage | Texture) -> ReliefTexture:
    """Take the first layer of a layered image with a parallel frame; f is turned round to point out of the surface.

    Raises
    ------
    RendererError
        The frame is a perspective one.
    """
    layers = layers.layers if isinstance(layers, Texture) else layers
    frame = layers.frame
    if not isinstance(frame, ParallelFrame):
        raise RendererError(
            "a relief texture needs a parallel frame, this texture has a perspective one; use relief range"
        )
    first, some = layers.offsets[:, :-1], np.diff(layers.offsets, axis=1) > 0
    height, color = np.full(layers.shape, np.nan, np.float32), np.zeros((*layers.shape, 3), np.float32)
    height[some], color[some] = -layers.depth[first[some]], layers.color[first[some]]
    return ReliefTexture(ParallelFrame(frame.origin, frame.a, frame.b, -frame.f), color, height)


def relief_from_mesh(
    mesh: Mesh, side: str = "+z", texels: int = 256, colors: MeshColors | None = None
) -> ReliefTexture:
    """Sample the side of a mesh orthographically from a face of its bounding box; heights count outward from it.

    Parameters
    ----------
    side : {"+x", "-x", "+y", "-y", "+z", "-z"}
    texels : int
        Texels along the longer edge of the face.
    colors : MeshColors, optional
        Of the mesh's faces; clay, shaded by a light from above, in front and left, unless given.

    Returns
    -------
    ReliefTexture
        Heights are at most 0 (on the face).
    """
    caster = MeshCaster(mesh)
    return _side(caster, painter_of(caster, colors), side, texels)


def _side(caster: MeshCaster, painter: Painter, side: str, texels: int) -> ReliefTexture:
    if side not in SIDES:
        raise ValueRangeError(f"side is {side!r}; choose among {', '.join(SIDES)}")
    mesh = caster.mesh
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    axis, sign, across, down = SIDES[side]
    texel = max(high[across] - low[across], high[down] - low[down]) / texels
    if not texel > 0:
        raise ValueRangeError(f"the mesh has no extent seen from {side}; choose another side")
    counts = [max(1, int(np.ceil((high[k] - low[k]) / texel - 1e-9))) for k in (across, down)]
    a, b, f = np.zeros((3, 3))
    a[across], b[down], f[axis] = texel, texel, sign
    origin = 0.5 * (low + high) - 0.5 * counts[0] * a - 0.5 * counts[1] * b
    origin[axis] = high[axis] if sign > 0 else low[axis]
    frame = ParallelFrame(origin, a, b, f)
    hits, hit = _cast(caster, frame, counts[1], counts[0], float(np.linalg.norm(high - low)))
    return ReliefTexture(frame, _painted(painter, frame, hits, hit), np.where(hit, hits[0], np.nan))


def _painted(painter: Painter, frame: ParallelFrame, hits: tuple[Array, Array, Array], hit: Array) -> Array:
    """Colours (H, W, 3) of what `_cast` met, each filtered to its texel."""
    color = np.zeros((*hit.shape, 3), np.float32)
    rays, right, down = (np.broadcast_to(each, (int(hit.sum()), 3)) for each in (-frame.f, frame.a, frame.b))
    color[hit] = np.maximum(painter.at(hits[1][hit], hits[2][hit], rays, (right, down)), 0.0)
    return color


def box_from_mesh(mesh: Mesh, texels: int = 256, colors: MeshColors | None = None) -> tuple[ReliefTexture, ...]:
    """Return the six relief textures on the faces of a mesh's bounding box (oliveira2000, sec. 4.1).

    Parameters as `relief_from_mesh` has them.
    """
    caster = MeshCaster(mesh)
    painter = painter_of(caster, colors)
    return tuple(_side(caster, painter, side, texels) for side in SIDES)


@dataclass(frozen=True, eq=False)
class Plane:
    """A rectangle that range data is resampled onto.

    Attributes
    ----------
    origin : (3,) outer corner of texel (0, 0), world
    across, down : (3,) the edges along columns and rows, world
    columns, rows : int
    near, far : float
        Depths counted from the plane along ``across x down``; nothing outside is kept.
    """

    origin: Array
    across: Array
    down: Array
    columns: int
    rows: int
    near: float = 0.0
    far: float = np.inf

    @property
    def frame(self) -> ParallelFrame:
        """The frame of the texture: f against the direction of looking."""
        normal = np.cross(self.across, self.down)
        length = np.linalg.norm(normal)
        if not length > 0 or self.columns < 1 or self.rows < 1:
            raise ValueRangeError("a plane needs two edges that span a rectangle and at least one texel along each")
        a, b = np.asarray(self.across) / self.columns, np.asarray(self.down) / self.rows
        return ParallelFrame(self.origin, a, b, -normal / length)


def reliefs_from_range(images: Sequence[DepthImage], planes: Sequence[Plane]) -> tuple[ReliefTexture, ...]:
    """Resample range data with photos onto planes (oliveira2000, sec. 4.4): the first surface behind each plane.

    Every depth image becomes a mesh whose neighbours are joined where their depths agree to 5 %, with its picture as
    texture; rays from the planes meet it, and read the picture filtered to their texel.

    Raises
    ------
    ShapeError
        There are no depth images, or nothing is in them.
    """
    parts = [_range_mesh(image) for image in images]
    starts = np.cumsum([0] + [len(points) for points, _ in parts])
    faces = [part + start for (_, part), start in zip(parts, starts, strict=False)]
    if sum(len(part) for part in faces) == 0:
        raise ShapeError("the range data holds no surface; give depth images with finite depths")
    mesh = Mesh(np.concatenate([points for points, _ in parts]), np.concatenate(faces))
    caster = MeshCaster(mesh)
    painter = ColorSampler(mesh, _photo_colors(images, [part for _, part in parts]))
    return tuple(_range_relief(caster, painter, plane) for plane in planes)


def _photo_colors(images: Sequence[DepthImage], faces: Sequence[Array]) -> MeshColors:
    """Colours of meshes whose vertices are the pixels of the images, by those images."""
    uv, index = [], []
    for number, (image, own) in enumerate(zip(images, faces, strict=True)):
        row, column = np.divmod(own, image.depth.shape[1])
        uv.append(np.stack([(column + 0.5) / image.depth.shape[1], (row + 0.5) / image.depth.shape[0]], axis=-1))
        index.append(np.full(len(own), number))
    textures = tuple(image.color for image in images)
    white = np.ones((sum(map(len, faces)), 3, 3))
    return MeshColors(white, np.concatenate(uv), textures, np.concatenate(index), wraps=False)


def _range_relief(caster: MeshCaster, painter: Painter, plane: Plane) -> ReliefTexture:
    frame = plane.frame
    hits, hit = _cast(caster, frame, plane.rows, plane.columns, -plane.near)
    hit &= -hits[0] <= plane.far
    return ReliefTexture(frame, _painted(painter, frame, hits, hit), np.where(hit, hits[0], np.nan))


def _cast(
    caster: MeshCaster, frame: ParallelFrame, rows: int, columns: int, start: float
) -> tuple[tuple[Array, Array, Array], Array]:
    """Cast against f from height `start`: ((height, face, uv) per texel, hit (H, W) bool)."""
    row, column = np.indices((rows, columns)) + 0.5
    origins = frame.origin + column[..., None] * frame.a + row[..., None] * frame.b + start * frame.f
    found = caster.cast(origins, np.broadcast_to(-frame.f, origins.shape))
    return (start - found.t.astype(np.float64), found.face, found.uv), np.isfinite(found.t)


def _range_mesh(image: DepthImage) -> tuple[Array, Array]:
    """Points (H W, 3) world and faces (F, 3) of a depth image."""
    camera, depth = image.camera, image.depth.astype(np.float64)
    row, column = np.indices(depth.shape)
    points = camera.center + np.nan_to_num(depth)[..., None] * camera.pixel_rays()
    index = row * depth.shape[1] + column
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, :-1], index[1:, 1:]
    faces = np.concatenate([np.stack(three, axis=-1).reshape(-1, 3) for three in ((a, c, b), (b, c, d))])
    corners = depth.ravel()[faces]
    one = np.isfinite(corners).all(axis=1)
    one &= np.nan_to_num(corners).max(axis=1) < SAME_SURFACE * np.nan_to_num(corners, nan=1.0).min(axis=1)
    return points.reshape(-1, 3), faces[one].astype(np.int32)


def asset_from_reliefs(reliefs: Sequence[ReliefTexture], names: Sequence[str], made_from: str) -> Asset:
    """Return the asset of relief textures: layered images of one layer, f into the surface, normals of the heights."""
    textures = tuple(Texture(layers_of_relief(relief)) for relief in reliefs)
    info = {
        "textures": [{"name": name} for name in names],
        "units": "scene units",
        "provenance": {"made": "ibrpipe relief", "from": made_from},
    }
    return Asset(textures, info)
