"""Support rectangles: where textures stand, what each of them faces. Source: gong-yang, sec. 4 and 4.1."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from pydantic import Field, model_validator

from ibrpipe.config import StageConfig
from ibrpipe.embree import MeshCaster
from ibrpipe.errors import ConfigError
from ibrpipe.modelling.frusta import Frustum
from ibrpipe.types import Array, Camera, Mesh, ParallelFrame

Vector = tuple[float, float, float]
#: rays along each side of a frustum that look for the nearest surface
PROBES = 128


class RectangleConfig(StageConfig):
    """A support rectangle placed by the user; u x v points from the rectangle into the scene."""

    name: str = Field(description="Name of the texture")
    origin: Vector = Field(description="World position of the corner where u = v = 0, scene units")
    u: Vector = Field(description="World vector of the edge along the columns, scene units")
    v: Vector = Field(description="World vector of the edge along the rows, scene units; at right angles to u")
    center: Vector | None = Field(
        None, description="Centre of projection, world; absent = parallel projection along u x v"
    )
    texel: float | None = Field(None, gt=0, description="Texel size, scene units; absent = chosen from the photos")

    @model_validator(mode="after")
    def _right_angles(self) -> RectangleConfig:
        u, v = np.array(self.u), np.array(self.v)
        lengths = np.linalg.norm(u) * np.linalg.norm(v)
        if not lengths > 0 or abs(u @ v) > 1e-6 * lengths:
            raise ValueError(f"rectangle {self.name!r}: u and v must be edges at right angles, got {self.u}, {self.v}")
        return self


@dataclass(frozen=True, eq=False)
class Rectangle:
    """A support rectangle of a given resolution.

    Attributes
    ----------
    name : str
    origin, u, v : (3,) float64
        Corner and whole edges, world; u x v points into the scene.
    width, height : int
        Texels along u and v.
    center : (3,) float64 or None
        Centre of a perspective projection; None = parallel.
    frustum : Frustum or None
        How it was placed, where it is the image of a frustum.
    """

    name: str
    origin: Array
    u: Array
    v: Array
    width: int
    height: int
    center: Array | None = None
    frustum: Frustum | None = None

    @property
    def f(self) -> Array:
        """Unit normal, into the scene."""
        normal = np.cross(self.u, self.v)
        return normal / np.linalg.norm(normal)

    @property
    def texel(self) -> float:
        """Width of a texel on the rectangle, scene units."""
        return float(np.linalg.norm(self.u)) / self.width

    @property
    def edges(self) -> ParallelFrame:
        """Parallel frame whose a and b are the whole edges (u and v run from 0 to 1)."""
        return ParallelFrame(self.origin, self.u, self.v, self.f)

    @property
    def frame(self) -> ParallelFrame | Camera:
        """Frame of the layered depth image."""
        a, b = self.u / self.width, self.v / self.height
        if self.center is None:
            return ParallelFrame(self.origin, a, b, self.f)
        x, y = a / np.linalg.norm(a), b / np.linalg.norm(b)
        rotation = np.stack([x, y, self.f])
        corner = rotation @ (self.origin - self.center)
        if not corner[2] > 0:
            raise ConfigError(f"rectangle {self.name!r}: the centre must lie behind it, on the side away from u x v")
        fx, fy = corner[2] / np.linalg.norm(a), corner[2] / np.linalg.norm(b)
        K = [[fx, 0, -fx * corner[0] / corner[2]], [0, fy, -fy * corner[1] / corner[2]], [0, 0, 1]]
        pose = np.concatenate([rotation, (-rotation @ self.center)[:, None]], axis=1)
        return Camera(np.array(K), pose, self.width, self.height)

    def rays(self) -> tuple[Array, Array]:
        """Origins and directions (H * W, 3) float64 through the texel centres; t along them is the layer's depth."""
        column, row = np.meshgrid(np.arange(self.width) + 0.5, np.arange(self.height) + 0.5)
        return self.rays_at(column.ravel(), row.ravel())

    def rays_at(self, column: Array, row: Array) -> tuple[Array, Array]:
        """Origins and directions (N, 3) float64 through places (N,) of the picture, texels, as those of `rays`."""
        c, r = column / self.width, row / self.height
        points = self.origin + c.reshape(-1, 1) * self.u + r.reshape(-1, 1) * self.v
        if self.center is None:
            return points, np.broadcast_to(self.f, points.shape)
        away = points - self.center
        return np.broadcast_to(self.center, points.shape), away / (away @ self.f)[:, None]

    def facing(self, points: Array, normals: Array) -> Array:
        """(N,) float64 cosine between normals and the direction back to the rectangle; -1 outside its volume."""
        local = points - self.origin
        depth = local @ self.f
        if self.center is None:
            toward, at = np.broadcast_to(-self.f, points.shape), local
        else:
            back = self.center - points
            toward = back / np.linalg.norm(back, axis=1, keepdims=True)
            reach = -(back @ self.f)
            near = (self.origin - self.center) @ self.f
            with np.errstate(divide="ignore", invalid="ignore"):
                at = self.center - back * (near / reach)[:, None] - self.origin
            depth = reach
        u, v = at @ self.u / (self.u @ self.u), at @ self.v / (self.v @ self.v)
        inside = (u >= 0) & (u <= 1) & (v >= 0) & (v <= 1) & (depth >= 0)
        return np.where(inside, (normals * toward).sum(axis=1), -1.0)

    def as_json(self) -> dict[str, Any]:
        """Plain values for plan.json."""
        return {
            "name": self.name,
            "projection": "parallel" if self.center is None else "perspective",
            "origin": self.origin.tolist(),
            "u": self.u.tolist(),
            "v": self.v.tolist(),
            "center": None if self.center is None else self.center.tolist(),
            "width": self.width,
            "height": self.height,
        }

    @classmethod
    def from_json(cls, data: dict[str, Any]) -> Rectangle:
        """Read what `as_json` wrote."""
        center = None if data["center"] is None else np.array(data["center"])
        origin, u, v = (np.array(data[key], float) for key in ("origin", "u", "v"))
        return cls(data["name"], origin, u, v, data["width"], data["height"], center)


def distinct(ray: Array, depth: Array, texel: float) -> Array:
    """(N,) bool: leave out hits that repeat the one before, as rays through an edge or a vertex meet all faces there.

    Parameters
    ----------
    ray, depth : (N,) by ray, then depth ascending; all hits face the same side
    texel : hits less than a thousandth of it apart are one
    """
    again = (ray[1:] == ray[:-1]) & (np.diff(depth) < 1e-3 * texel)
    return np.concatenate([np.ones(min(len(ray), 1), bool), ~again])


def passed(rectangles: Sequence[Rectangle], points: Array, toward: Array) -> Array:
    """Say through which rectangle each view ray passes, as the residual pass of the renderer does.

    Parameters
    ----------
    points : (N, 3) world, on the surface
    toward : (N, 3) world, unit, from the surface to the viewer

    Returns
    -------
    (N,) int64
        Of the rectangles that the ray passes the one that it meets most squarely; where it passes none, the one that
        the direction is most square to.
    """
    order = []
    for rectangle in rectangles:
        local, square = points - rectangle.origin, -(toward @ rectangle.f)
        reach = (local @ rectangle.f) / np.where(square > 0.02, square, np.inf)
        at = local + toward * reach[:, None]
        u, v = (at @ edge / (edge @ edge) for edge in (rectangle.u, rectangle.v))
        inside = (square > 0.02) & (u >= 0) & (u <= 1) & (v >= 0) & (v <= 1)
        order.append(np.where(inside, 1.0 + square, square))
    return np.asarray(np.argmax(order, axis=0))


def sized(config: RectangleConfig, texel: float) -> Rectangle:
    """Give a user's rectangle its resolution."""
    step = config.texel or texel
    u, v = np.array(config.u), np.array(config.v)
    width, height = (max(1, round(float(np.linalg.norm(edge)) / step)) for edge in (u, v))
    center = None if config.center is None else np.array(config.center)
    return Rectangle(config.name, np.array(config.origin), u, v, width, height, center)


def before_surface(name: str, frustum: Frustum, caster: MeshCaster, texel: float) -> Rectangle:
    """Return the image of a frustum as a rectangle right before the surface; texels have their size at its target."""
    camera = frustum.camera(PROBES)
    seen = caster.cast_camera(camera).t
    x, y, f = camera.R
    away = float((np.array(frustum.target) - camera.center) @ f)
    near = 0.999 * float(seen.min()) if np.isfinite(seen).any() else away
    slope = float(np.tan(np.radians(frustum.fov) / 2))
    side, half = max(2, round(2 * slope * away / texel)), near * slope
    corner = camera.center + near * f - half * x - half * y
    return Rectangle(name, corner, 2 * half * x, 2 * half * y, side, side, camera.center, frustum)


def bounding_box(mesh: Mesh) -> tuple[Array, Array, Array, str]:
    """Return (centre, axes, half sizes, reason) of the box: the oriented one only where it is clearly smaller.

    Axes are rows of a rotation matrix, ordered and signed so as to stay close to the world's.
    """
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    aligned = (low + high) / 2, np.eye(3), (high - low) / 2
    axes = _tightest_axes(mesh.vertices - low)
    if axes is None:  # a flat mesh has no hull
        return *aligned, "the mesh is flat, so its box is axis-aligned"
    along = (mesh.vertices - low) @ axes.T
    half = np.ptp(along, axis=0) / 2
    saved = 100 * (1 - float(np.prod(half) / np.prod(aligned[2])))
    if saved < 10:
        return *aligned, f"axis-aligned box: the best oriented one saves only {max(saved, 0.0):.0f} %"
    center = (along.min(axis=0) + along.max(axis=0)) / 2 @ axes + low
    return center, *_near_world(axes, half), f"oriented box: it is {saved:.0f} % smaller than the axis-aligned one"


def _tightest_axes(points: Array) -> Array | None:
    """Return the axes (rows) of about the smallest box around points (N, 3), or None where they lie in a plane.

    Open3D's search takes minutes on round meshes and loses its axes on some boxes and regular grids. It therefore sees
    only the outermost points along 500 directions, a second time moved by a millionth where it lost its axes, and the
    caller measures the box along them itself.
    """
    number = np.arange(500)
    z, angle = (2 * number + 1) / 500 - 1, number * np.pi * (3 - np.sqrt(5))
    across = np.sqrt(1 - z * z)
    directions = np.stack([across * np.cos(angle), across * np.sin(angle), z])
    outermost = points[np.unique([int((points @ d).argmax()) for d in directions.T])]
    moved = 1e-6 * np.ptp(points) * np.random.default_rng(0).uniform(-1, 1, outermost.shape)
    try:
        axes = _box_axes(outermost)
        return axes if axes is not None else _box_axes(outermost + moved)
    except RuntimeError:
        return None


def _box_axes(points: Array) -> Array | None:
    """Return the axes of Open3D's smallest box, None where they do not fit it; RuntimeError for points in a plane."""
    from ibrpipe.native_imports import import_open3d

    o3d = import_open3d()
    with o3d.utility.VerbosityContextManager(o3d.utility.VerbosityLevel.Error):
        cloud = o3d.utility.Vector3dVector(points)
        box = o3d.geometry.OrientedBoundingBox.create_from_points_minimal(cloud, robust=True)
    left, _, right = np.linalg.svd(np.array(box.R).T)
    axes = left @ right  # Open3D's are orthogonal to about 1e-8 only
    return axes if np.prod(np.ptp(points @ axes.T, axis=0)) <= 1.01 * np.prod(box.extent) else None


def _near_world(axes: Array, half: Array) -> tuple[Array, Array]:
    """Reorder and flip axes so that each lies nearest its world axis, determinant +1."""
    left, order = [0, 1, 2], []
    for world in range(3):
        order.append(max(left, key=lambda i: abs(axes[i][world])))
        left.remove(order[-1])
    axes, half = axes[order].copy(), half[order]
    for i in range(3):
        if axes[i, i] < 0:
            axes[i] *= -1
    if np.linalg.det(axes) < 0:
        axes[2] *= -1
    return axes, half


def box_faces(center: Array, axes: Array, half: Array, texel: float) -> list[Rectangle]:
    """Return the six faces of a box as parallel rectangles, sides upright, with one texel of margin."""
    half = np.maximum(half, texel) + texel
    faces = []
    for axis, name in enumerate("xyz"):
        for sign, mark in ((1.0, "+"), (-1.0, "-")):
            f = -sign * axes[axis]
            v = -axes[2] if axis < 2 else -axes[1]  # rows run down the picture
            u = np.cross(v, f)
            hu, hv = (float(np.abs(axes @ edge) @ half) for edge in (u, v))
            width, height = max(2, round(2 * hu / texel)), max(2, round(2 * hv / texel))
            corner = center - f * half[axis] - u * hu - v * hv
            faces.append(Rectangle(mark + name, corner, 2 * hu * u, 2 * hv * v, width, height))
    return faces
