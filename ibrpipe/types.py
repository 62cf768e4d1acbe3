"""What the pipeline speaks of: cameras, frames of reference, textures, assets, rendered frames.

Conventions (all of them are explained in ``docs/concepts.md``): OpenCV camera axes (x right, y down, z forward);
``cam_from_world`` maps world points to camera points; the centre of pixel (0, 0) is at (0.5, 0.5); colour is linear
light with Rec.709 primaries; rays and poses are float64, stored arrays float32; indices are int32 or int64.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ibrpipe.errors import ShapeError, ValueRangeError

Array = NDArray[Any]


def _array(name: str, value: ArrayLike, shape: tuple[int, ...], dtype: Any = np.float64) -> Array:
    """Return a read-only copy of `value`; every entry finite, shape as stated."""
    array = np.array(value, dtype=dtype)
    if array.shape != shape:
        raise ShapeError(f"{name} must have shape {shape}, got {array.shape}")
    if not np.isfinite(array).all():
        raise ValueRangeError(f"{name} holds NaN or infinity: {array.tolist()}; every entry must be finite")
    array.setflags(write=False)
    return array


def _view(name: str, value: ArrayLike, dtype: Any, ndim: int) -> Array:
    """Return `value` as a C-contiguous array without copying where possible."""
    array = np.ascontiguousarray(value, dtype=dtype)
    if array.ndim != ndim:
        raise ShapeError(f"{name} must have {ndim} axes, got shape {array.shape}")
    return array


@dataclass(frozen=True, eq=False)
class Camera:
    """A pinhole camera.

    Attributes
    ----------
    K : (3, 3) float64
        Calibration matrix in pixels; last row 0 0 1. Pixel (0, 0)'s centre is at (0.5, 0.5).
    cam_from_world : (3, 4) float64
        Rotation and translation, world to camera, OpenCV axes, scene units.
    width, height : int
        Size in pixels.

    Raises
    ------
    ShapeError, ValueRangeError
        Wrong shapes, NaN, a size below 1, a focal length that is not positive, or a left part that is no rotation.
    """

    K: Array
    cam_from_world: Array
    width: int
    height: int

    def __post_init__(self) -> None:
        object.__setattr__(self, "K", _array("K", self.K, (3, 3)))
        object.__setattr__(self, "cam_from_world", _array("cam_from_world", self.cam_from_world, (3, 4)))
        object.__setattr__(self, "width", int(self.width))
        object.__setattr__(self, "height", int(self.height))
        if self.width < 1 or self.height < 1:
            raise ValueRangeError(f"camera size is {self.width} x {self.height}; both must be at least 1 pixel")
        if not (self.K[0, 0] > 0 and self.K[1, 1] > 0):
            raise ValueRangeError(f"focal lengths are {self.K[0, 0]}, {self.K[1, 1]} px; both must be positive")
        if not np.allclose(self.K[2], (0.0, 0.0, 1.0)) or self.K[1, 0] != 0.0:
            raise ValueRangeError("K must be upper triangular with last row 0 0 1")
        if np.abs(self.R @ self.R.T - np.eye(3)).max() > 1e-4 or np.linalg.det(self.R) < 0:
            raise ValueRangeError("the left 3x3 of cam_from_world must be a rotation (orthonormal, determinant +1)")

    @property
    def R(self) -> Array:
        """Rotation, world to camera, (3, 3) float64."""
        return self.cam_from_world[:, :3]

    @property
    def t(self) -> Array:
        """Translation, world to camera, (3,) float64."""
        return self.cam_from_world[:, 3]

    @property
    def center(self) -> Array:
        """Centre of projection in the world, (3,) float64."""
        return -self.R.T @ self.t

    @property
    def world_from_pixel(self) -> Array:
        """(3, 3) float64: world direction of pixel (x, y) is this @ (x, y, 1); its camera z is 1."""
        return self.R.T @ np.linalg.inv(self.K)

    def resized(self, width: int, height: int) -> Camera:
        """Return the same view at another size in pixels."""
        scale = np.diag([width / self.width, height / self.height, 1.0])
        return Camera(scale @ self.K, self.cam_from_world, width, height)

    @classmethod
    def look_at(
        cls,
        eye: ArrayLike,
        target: ArrayLike,
        up: ArrayLike = (0.0, 0.0, 1.0),
        fov_y_deg: float = 40.0,
        width: int = 640,
        height: int = 480,
    ) -> Camera:
        """Return a camera at `eye` looking at `target`, with world vector `up` pointing up in the picture."""
        eye64, forward = np.asarray(eye, float), np.asarray(target, float) - np.asarray(eye, float)
        length = np.linalg.norm(forward)
        if not length > 0:
            raise ValueRangeError("eye and target are the same point; move one of them")
        forward = forward / length
        right = np.cross(forward, np.asarray(up, float))
        if np.linalg.norm(right) < 1e-12:
            right = np.cross(forward, (0.0, 1.0, 0.0) if abs(forward[1]) < 0.9 else (1.0, 0.0, 0.0))
        right = right / np.linalg.norm(right)
        R = np.stack([right, np.cross(forward, right), forward])
        focal = height / (2.0 * np.tan(np.radians(fov_y_deg) / 2.0))
        K = [[focal, 0.0, width / 2.0], [0.0, focal, height / 2.0], [0.0, 0.0, 1.0]]
        return cls(np.array(K), np.concatenate([R, (-R @ eye64)[:, None]], axis=1), width, height)


@dataclass(frozen=True, eq=False)
class Mesh:
    """A triangle mesh in world units.

    Attributes
    ----------
    vertices : (V, 3) float64
    faces : (F, 3) int32, counter-clockwise seen from outside
    """

    vertices: Array
    faces: Array

    def __post_init__(self) -> None:
        vertices, faces = _view("vertices", self.vertices, np.float64, 2), _view("faces", self.faces, np.int32, 2)
        if vertices.shape[1:] != (3,) or faces.shape[1:] != (3,):
            raise ShapeError(f"vertices and faces must be (N, 3), got {vertices.shape} and {faces.shape}")
        if len(faces) == 0:
            raise ShapeError("the mesh has no faces; give a surface, not a point cloud")
        if not np.isfinite(vertices).all():
            raise ValueRangeError("the mesh has vertices that are NaN or infinite; repair it")
        if faces.min() < 0 or faces.max() >= len(vertices):
            raise ValueRangeError(f"a face names vertex {faces.max()} of {len(vertices)}; the mesh file is damaged")
        object.__setattr__(self, "vertices", vertices)
        object.__setattr__(self, "faces", faces)


@dataclass(frozen=True, eq=False)
class ParallelFrame:
    """A parallel projection: ``X = origin + u*a + v*b + d*f`` (oliveira2000, fig. 4).

    Attributes
    ----------
    origin : (3,) float64
        World point of u = v = d = 0, the outer corner of texel (0, 0), whose centre is at u = v = 0.5.
    a, b : (3,) float64
        World vectors of one texel along u (columns) and v (rows); they need not be orthogonal.
    f : (3,) float64
        Unit vector along which depth (or height) d is counted, scene units; need not be orthogonal to a and b.
    """

    origin: Array
    a: Array
    b: Array
    f: Array

    def __post_init__(self) -> None:
        for name in ("origin", "a", "b", "f"):
            object.__setattr__(self, name, _array(name, getattr(self, name), (3,)))
        if abs(np.linalg.norm(self.f) - 1.0) > 1e-6:
            raise ValueRangeError(f"f must be a unit vector, got length {np.linalg.norm(self.f)}; normalise it")
        volume = abs(np.linalg.det(self.world_from_local))
        if not volume > 1e-9 * np.linalg.norm(self.a) * np.linalg.norm(self.b):
            raise ValueRangeError("a, b and f are linearly dependent: the support rectangle is degenerate")

    @property
    def world_from_local(self) -> Array:
        """(3, 3) float64 matrix with columns a, b, f."""
        return np.stack([self.a, self.b, self.f], axis=1)

    @property
    def local_from_world(self) -> Array:
        """(3, 3) float64 inverse of `world_from_local`; apply it to X - origin."""
        return np.linalg.inv(self.world_from_local)


@dataclass(frozen=True, eq=False)
class ReliefTexture:
    """A colour image with a height (displacement) per texel in a parallel frame.

    The surface is the bilinear interpolation of `height` between texel centres; NaN marks transparent texels.

    Attributes
    ----------
    frame : ParallelFrame
    color : (H, W, 3) float32, linear light
    height : (H, W) float32, scene units along ``frame.f``; NaN = transparent
    """

    frame: ParallelFrame
    color: Array
    height: Array

    def __post_init__(self) -> None:
        color, height = _view("color", self.color, np.float32, 3), _view("height", self.height, np.float32, 2)
        if color.shape != (*height.shape, 3) or height.size == 0:
            raise ShapeError(f"color must be (H, W, 3) for height (H, W), got {color.shape} and {height.shape}")
        if np.isinf(height).any():
            raise ValueRangeError("height holds infinity; use NaN for transparent texels")
        _check_color(color)
        object.__setattr__(self, "color", color)
        object.__setattr__(self, "height", height)


@dataclass(frozen=True, eq=False)
class DepthImage:
    """A perspective colour image with depth: the camera's own view of a surface.

    Attributes
    ----------
    camera : Camera
    color : (H, W, 3) float32, linear light
    depth : (H, W) float32, along camera z, scene units; +inf or NaN = nothing there
    """

    camera: Camera
    color: Array
    depth: Array

    def __post_init__(self) -> None:
        shape = (self.camera.height, self.camera.width)
        color, depth = _view("color", self.color, np.float32, 3), _view("depth", self.depth, np.float32, 2)
        if depth.shape != shape or color.shape != (*shape, 3):
            raise ShapeError(f"color and depth must be {shape}, got {color.shape[:2]} and {depth.shape}")
        depth = np.where(np.isposinf(depth), np.float32(np.nan), depth)
        if (depth <= 0).any():
            raise ValueRangeError("depth must be positive in front of the camera; use +inf where nothing is seen")
        _check_color(color)
        object.__setattr__(self, "color", color)
        object.__setattr__(self, "depth", depth)


@dataclass(frozen=True, eq=False)
class LayeredDepthImage:
    """Several depth samples per pixel: the view-independent half of a spiral texture (gong-yang, sec. 4.1).

    Attributes
    ----------
    frame : ParallelFrame or Camera
    offsets : (H, W + 1) int64
        Pixel (row, column) owns samples ``offsets[row, column]`` to ``offsets[row, column + 1]`` (exclusive);
        ``offsets[row, W] == offsets[row + 1, 0]``.
    depth : (S,) float32
        Ascending within a pixel, scene units along ``frame.f`` (parallel) or camera z (perspective).
    color : (S, 3) float32, linear diffuse colour
    normal : (S, 3) float32, unit, world space; NaN where unknown
    observers : (S,) int32 or None
        How many photos the colour comes from; 0 = declared as unseen.
    """

    frame: ParallelFrame | Camera
    offsets: Array
    depth: Array
    color: Array
    normal: Array
    observers: Array | None = None

    def __post_init__(self) -> None:
        offsets = _view("offsets", self.offsets, np.int64, 2)
        depth = _view("depth", self.depth, np.float32, 1)
        color, normal = _view("color", self.color, np.float32, 2), _view("normal", self.normal, np.float32, 2)
        height, width = offsets.shape[0], offsets.shape[1] - 1
        if height < 1 or width < 1:
            raise ShapeError(f"offsets must be (H, W + 1) with H, W >= 1, got {offsets.shape}")
        chained = (offsets[1:, 0] == offsets[:-1, -1]).all() and (np.diff(offsets, axis=1) >= 0).all()
        if offsets[0, 0] != 0 or offsets[-1, -1] != len(depth) or not chained:
            raise ValueRangeError(f"offsets must rise from 0 to the {len(depth)} samples, row after row")
        if color.shape != (len(depth), 3) or normal.shape != (len(depth), 3):
            raise ShapeError(f"color and normal must be ({len(depth)}, 3), got {color.shape} and {normal.shape}")
        if not np.isfinite(depth).all():
            raise ValueRangeError("depth of a layered depth image holds NaN or infinity; leave such samples out")
        starts = np.zeros(len(depth) + 1, bool)
        starts[offsets[:, :-1].ravel()] = True
        if len(depth) > 1 and (np.diff(depth)[~starts[1:-1]] < 0).any():
            raise ValueRangeError("depths must ascend within every pixel; sort the samples")
        if isinstance(self.frame, Camera):
            if (self.frame.height, self.frame.width) != (height, width):
                raise ShapeError(f"offsets are for {width} x {height} pixels but the camera is another size")
            if (depth <= 0).any():
                raise ValueRangeError("depth must be positive in front of the camera")
        _check_color(color)
        for name, value in (("offsets", offsets), ("depth", depth), ("color", color), ("normal", normal)):
            object.__setattr__(self, name, value)
        if self.observers is not None:
            object.__setattr__(self, "observers", _view("observers", self.observers, np.int32, 1))

    @property
    def shape(self) -> tuple[int, int]:
        """(H, W) in texels."""
        return self.offsets.shape[0], self.offsets.shape[1] - 1


@dataclass(frozen=True, eq=False)
class SpiralResiduals:
    """View-dependent half of a spiral texture: one residual image per spiral direction (gong-yang, sec. 4.2).

    Image i samples the support rectangle along ``directions[i]`` with its own size; texel (0, 0)'s outer corner is the
    rectangle's outer corner, whatever the size.

    Attributes
    ----------
    rectangle : ParallelFrame
        Its ``a`` and ``b`` are the *whole* edges of the support rectangle, orthogonal, and ``f`` is normal to both.
    k : float
        Spiral density: adjacent turns are 2 k pi apart.
    alphas : (n,) float64
        Spiral parameter of every image, ascending.
    directions : (n, 3) float64
        Unit vectors in the rectangle's frame (along a, b, -f), pointing away from the object.
    sizes : (n, 2) int32
        Height and width of every image.
    starts : (n + 1,) int64
        Image i owns texels ``starts[i]`` to ``starts[i + 1]``, row-major.
    texels : (T, 3) uint8 or float32
        uint8: sRGB-coded colour minus sRGB-coded diffuse colour plus `zero`. float32: linear colour minus diffuse.
    valid : (T,) bool
        False where the ray hits nothing or no photo sees what it hits.
    zero : int
        Code of a residual of nothing (uint8 texels only).
    closed : bool
        The spiral has its closing turn along the horizon.
    """

    rectangle: ParallelFrame
    k: float
    alphas: Array
    directions: Array
    sizes: Array
    starts: Array
    texels: Array
    valid: Array
    zero: int = 32
    closed: bool = True

    def __post_init__(self) -> None:
        if not 0 < self.k <= 1:
            raise ValueRangeError(f"k is {self.k}; it must lie in (0, 1]")
        basis = self.rectangle.world_from_local / np.linalg.norm(self.rectangle.world_from_local, axis=0)
        if np.abs(basis.T @ basis - np.eye(3)).max() > 1e-6:
            raise ValueRangeError("the support rectangle of residuals must have right angles, f normal to it")
        n = len(self.directions)
        areas = np.asarray(self.sizes, np.int64).prod(axis=1) if n else np.zeros(0, np.int64)
        if np.shape(self.starts) != (n + 1,) or (np.diff(self.starts) != areas).any():
            raise ShapeError("starts must step by each image's height * width")
        if self.texels.shape != (int(self.starts[-1]), 3) or self.valid.shape != (int(self.starts[-1]),):
            raise ShapeError(f"texels and valid must hold {int(self.starts[-1])} texels, got {self.texels.shape}")
        if self.texels.dtype not in (np.uint8, np.float32):
            raise ShapeError(f"texels must be uint8 or float32, got {self.texels.dtype}")


@dataclass(frozen=True, eq=False)
class SpiralTexture:
    """A layered depth image and, where the scene needs it, its view-dependent residuals."""

    layers: LayeredDepthImage
    residuals: SpiralResiduals | None = None


@dataclass(frozen=True, eq=False)
class Asset:
    """A finished asset: any number of spiral textures and what is known of their making.

    Attributes
    ----------
    textures : tuple of SpiralTexture
    info : mapping
        The content of ``asset.json`` (units, provenance, measured errors); empty for assets made in memory.
    """

    textures: tuple[SpiralTexture, ...]
    info: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Frame:
    """A rendered picture. What was not asked for is None.

    Attributes
    ----------
    color : (H, W, 3) float32, linear light, 0 where nothing is hit
    depth : (H, W) float32, along camera z, scene units, +inf where nothing is hit
    alpha : (H, W) float32, 1 where something is hit
    stats : mapping of figures such as ``rays``, ``hits``, ``milliseconds``
    """

    color: Array | None
    depth: Array | None
    alpha: Array | None
    stats: Mapping[str, Any] = field(default_factory=dict)


def _check_color(color: Array) -> None:
    if not np.isfinite(color).all():
        raise ValueRangeError("color holds NaN or infinity; repair the image before making a texture of it")
    if color.size and color.min() < 0:
        raise ValueRangeError(f"color holds negative light ({color.min():.4g}); clip it to 0")
