"""What is rendered in ``speed-error``: height fields and objects of growing size, each with its views and its truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Literal

import numpy as np

from ibrpipe.bench.oracles import fields
from ibrpipe.bench.oracles.surface import Surface, build_surface, first_layer
from ibrpipe.embree import MeshCaster
from ibrpipe.types import Array, Camera, LayeredDepthImage, Mesh, ParallelFrame, ReliefTexture, Texture
from ibrpipe.types.layers import offsets_of
from ibrpipe.types.renderable import GridSource

#: heights of the synthetic height field, share of its width
AMPLITUDE = 0.15
#: cells along each side from which height fields of all sizes are taken
FINEST = 2048
#: what the name of an object ends in of which only the first layers are kept
FIRST = ", first layers"
#: samples along each side of a pixel for the true colour, and every how many pixels it is compared
SUPERSAMPLES, STRIDE = 4, 4


@dataclass(frozen=True, eq=False)
class Workload:
    """Something to render.

    Attributes
    ----------
    name : str
    kind : str
        "height field" or "object".
    n : int
        Texels along a side; of an object along its longest side.
    sources : tuple of textures
    mesh : Mesh
        The same surface as triangles: of a height field two for each cell; of an object what it was sampled from.
    size : float
        Width of the field, or diagonal of the object, in scene units.
    views : mapping of name to Camera
    """

    name: str
    kind: Literal["height field", "object"]
    n: int
    sources: tuple[GridSource, ...]
    mesh: Mesh
    size: float
    views: dict[str, Camera]

    @cached_property
    def surfaces(self) -> tuple[Surface, ...]:
        """The surfaces of all sources."""
        return tuple(build_surface(source) for source in self.sources)

    @cached_property
    def caster(self) -> MeshCaster:
        """The mesh prepared for ray casting."""
        return MeshCaster(self.mesh)

    @property
    def texels(self) -> int:
        """Stored depths."""
        return sum(_depths(source).size for source in self.sources)

    def true_colors(self, camera: Camera) -> Array:
        """(h, w, 3) float64 mean colour over every `STRIDE`-th pixel, black where nothing is."""
        pixels = strided(camera)
        offsets = (np.arange(SUPERSAMPLES) + 0.5) / SUPERSAMPLES
        dy, dx = np.meshgrid(offsets, offsets, indexing="ij")
        points = pixels.reshape(-1, 1, 2) + np.stack([dx, dy], axis=-1).reshape(1, -1, 2)
        color = self.colors_along(camera, points.reshape(-1, 2))
        return color.reshape(*pixels.shape[:2], -1, 3).mean(axis=2)

    def colors_along(self, camera: Camera, points: Array) -> Array:
        """(N, 3) float64 colour of the surface that was meant at places (N, 2) of the picture."""
        if self.kind == "height field":
            hits = fields.cast(self.surfaces, camera, points, brute=False)
            return fields.colors_at(self.surfaces, camera, points, hits)[0]
        rays = camera.pixel_rays(points)
        t = self.caster.cast(camera.center, rays).t.astype(np.float64)
        there = np.isfinite(t)
        out = np.zeros((len(points), 3))
        out[there] = paint((camera.center + t[there, None] * rays[there]) / self.size)
        return out


def _depths(source: GridSource) -> Array:
    if isinstance(source, ReliefTexture):
        return source.height
    return source.layers.depth if isinstance(source, Texture) else source.depth


def strided(camera: Camera) -> Array:
    """(h, w, 2) float64: upper left corners of the pixels whose colour is compared."""
    y, x = np.meshgrid(
        np.arange(STRIDE // 2, camera.height, STRIDE), np.arange(STRIDE // 2, camera.width, STRIDE), indexing="ij"
    )
    return np.stack([x, y], axis=-1).astype(np.float64)


def paint(points: Array) -> Array:
    """(N, 3) colours, linear light, of (N, 3) points; features about a fiftieth of a unit wide."""
    x, y, z = np.asarray(points, np.float64).T
    stripes = 0.5 + 0.5 * np.tanh(6.0 * np.sin(60.0 * x + 20.0 * np.sin(5.0 * y)))
    return np.stack(
        [
            0.15 + 0.6 * stripes,
            0.3 + 0.3 * np.sin(50.0 * y) * np.cos(40.0 * z),
            0.55 - 0.35 * stripes * np.cos(30.0 * x),
        ],
        axis=1,
    ).clip(0.0, 1.0)


def rough_heights(n: int, seed: int = 11) -> Array:
    """(n, n) float32 heights from 0 to `AMPLITUDE`: a fractal with sharp blocks, the border at 0.

    Every size shows the same field: the finest one is made once and point-sampled.
    """
    step = FINEST // n
    field = _finest(seed)[step // 2 :: step, step // 2 :: step][:n, :n]
    field = (field - field.min()) / np.ptp(field) * AMPLITUDE
    field[[0, -1]] = 0.0
    field[:, [0, -1]] = 0.0
    return field.astype(np.float32)


@lru_cache(maxsize=1)
def _finest(seed: int) -> Array:
    fine, rng = FINEST, np.random.default_rng(seed)
    frequency = np.hypot(np.fft.fftfreq(fine)[:, None] * fine, np.fft.rfftfreq(fine)[None] * fine)
    frequency[0, 0] = np.inf
    noise = rng.standard_normal((256, 256)).repeat(fine // 256, 0).repeat(fine // 256, 1)
    field = np.fft.irfft2(np.fft.rfft2(noise) * frequency**-1.4, s=(fine, fine))
    field = 0.75 * (field - field.min()) / np.ptp(field)
    for x, y, wide, high, up in rng.random((40, 5)):
        rows = slice(int((0.05 + 0.85 * y) * fine), int((0.05 + 0.85 * y + 0.06 * high + 0.01) * fine))
        columns = slice(int((0.05 + 0.85 * x) * fine), int((0.05 + 0.85 * x + 0.06 * wide + 0.01) * fine))
        field[rows, columns] += 0.5 * up - 0.15
    return field


def height_field(n: int, width: int, views: Sequence[str] = ()) -> Workload:
    """Return the synthetic height field of n by n texels on the unit square, in pictures `width` pixels wide."""
    heights = rough_heights(n)
    p = 1.0 / (n - 1)
    frame = ParallelFrame(
        np.array([-p / 2, -p / 2, 0]), np.array([p, 0, 0]), np.array([0, p, 0]), np.array([0, 0, 1.0])
    )
    y, x = np.mgrid[:n, :n] * p
    points = np.stack([x, y, heights], axis=-1).reshape(-1, 3)
    color = paint(points).reshape(n, n, 3).astype(np.float32)
    cameras = field_views(width)
    chosen = {name: cameras[name] for name in views or cameras}
    mesh = Mesh(points, grid_faces(n))
    return Workload(f"height field {n}", "height field", n, (ReliefTexture(frame, color, heights),), mesh, 1.0, chosen)


def grid_faces(n: int) -> Array:
    """(2 (n-1)^2, 3) int32: two triangles for each cell of n by n vertices, cut from (0, 0) to (1, 1)."""
    corner = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    one = np.stack([corner, corner + 1, corner + n + 1], axis=1)
    other = np.stack([corner, corner + n + 1, corner + n], axis=1)
    return np.stack([one, other], axis=1).reshape(-1, 3).astype(np.int32)


def field_views(width: int) -> dict[str, Camera]:
    """Four views of the unit square: from the front, 60 degrees off, grazing at 85 degrees, and close."""
    height = width * 3 // 4

    def aim(degrees: float, azimuth: float, distance: float, target: tuple[float, float, float], fov: float) -> Camera:
        t, s = np.radians(degrees), np.radians(azimuth)
        direction = np.array([np.sin(t) * np.cos(s), np.sin(t) * np.sin(s), np.cos(t)])
        up = (0, 1, 0) if degrees == 0 else (0, 0, 1)
        return Camera.look_at(np.array(target) + distance * direction, target, up, fov, width, height)

    return {
        "frontal": aim(0.0, 0.0, 1.3, (0.5, 0.5, 0.0), 42.0),
        "oblique 60": aim(60.0, -65.0, 1.25, (0.5, 0.5, 0.05), 36.0),
        "grazing 85": aim(85.0, -65.0, 1.3, (0.5, 0.5, 0.05), 16.0),
        "close": aim(50.0, -115.0, 0.25, (0.55, 0.5, 0.06), 45.0),
    }


def region_views(width: int) -> dict[str, Camera]:
    """One view for each of the nine regions in which the eye's epipole lies, seen from the texture."""
    rows, columns = {"above": -0.7, "within": 0.5, "below": 1.7}, {"left": -0.7, "middle": 0.5, "right": 1.7}
    return {
        f"{row} {column}": Camera.look_at((x, y, 1.3), (0.5, 0.5, 0.05), (0.3, 1, 0), 40.0, width, width)
        for row, y in rows.items()
        for column, x in columns.items()
    }


def bumpy_torus(steps: int = 400) -> Mesh:
    """Return a torus of radii 1 and 0.4 with bumps, as triangles."""
    u, v = np.meshgrid(np.arange(steps) * 2 * np.pi / steps, np.arange(steps // 2) * 4 * np.pi / steps, indexing="ij")
    tube = 0.4 + 0.03 * np.sin(9 * u) * np.sin(6 * v)
    points = np.stack([(1 + tube * np.cos(v)) * np.cos(u), (1 + tube * np.cos(v)) * np.sin(u), tube * np.sin(v)], -1)
    i, j = np.meshgrid(np.arange(steps), np.arange(steps // 2), indexing="ij")
    a, b = i * (steps // 2) + j, (i + 1) % steps * (steps // 2) + j
    c, d = i * (steps // 2) + (j + 1) % (steps // 2), (i + 1) % steps * (steps // 2) + (j + 1) % (steps // 2)
    faces = np.stack([np.stack([a, b, d], -1), np.stack([a, d, c], -1)], axis=2).reshape(-1, 3)
    return Mesh(points.reshape(-1, 3), faces.astype(np.int32))


def object_of(mesh: Mesh, name: str, n: int, width: int, first: bool = False) -> Workload:
    """Return six layered images of a mesh, or their first layers, n texels along its longest side; two views."""
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    size, middle = float(np.linalg.norm(high - low)), (low + high) / 2
    views = {
        label: Camera.look_at(middle + size * np.array(direction), middle, (0, 0, 1), 50.0, width, width * 3 // 4)
        for label, direction in (("corner", (0.75, 0.55, 0.6)), ("side", (0.1, -1.05, 0.15)))
    }
    sources = tuple(first_layer(each) if first else each for each in six_faces(mesh, n, size))
    return Workload(f"{name} {n}{FIRST if first else ''}", "object", n, sources, mesh, size, views)


def six_faces(mesh: Mesh, n: int, size: float, steepest_deg: float = 70.0) -> list[LayeredDepthImage]:
    """Return the layered images of a mesh from the six faces of its bounding box, all layers that face each side."""
    caster, low, high = MeshCaster(mesh), mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    texel, made = float((high - low).max()) / n, []
    for axis in range(3):
        for sign in (1, -1):
            u, v = [k for k in range(3) if k != axis][::sign]
            a, b, f = texel * np.eye(3)[u], texel * np.eye(3)[v], -sign * np.eye(3)[axis]
            columns, rows = (max(1, int(np.ceil((high - low)[k] / texel))) for k in (u, v))
            origin = (low + high) / 2 - a * columns / 2 - b * rows / 2 - f * ((high - low)[axis] / 2 + texel)
            y, x = np.mgrid[:rows, :columns] + 0.5
            starts = (origin + x[..., None] * a + y[..., None] * b).reshape(-1, 3)
            ray, hits = caster.cast_all(starts, np.broadcast_to(f, starts.shape))
            keep = hits.normal @ f < -np.cos(np.radians(steepest_deg))
            offsets = offsets_of(np.bincount(ray[keep], minlength=rows * columns).reshape(rows, columns))
            points = starts[ray[keep]] + hits.t[keep, None].astype(np.float64) * f
            frame = ParallelFrame(origin, a, b, f)
            made.append(LayeredDepthImage(frame, offsets, hits.t[keep], paint(points / size), hits.normal[keep]))
    return made
