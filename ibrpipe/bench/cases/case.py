"""What a hard case is."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ibrpipe.bench.oracles.surface import Surface, build_surface
from ibrpipe.types import (
    Array,
    Camera,
    DepthImage,
    Instances,
    LayeredDepthImage,
    Mesh,
    ParallelFrame,
    ReliefTexture,
    Scene,
)
from ibrpipe.types.prerendered import PrerenderedScene
from ibrpipe.types.relief_mesh import ReliefMesh
from ibrpipe.types.renderable import GridSource

GROUPS = {
    1: "where the eye is",
    2: "where the epipole is",
    3: "how rays run",
    4: "what the surface is like",
    5: "sizes and distances",
    6: "depth in few bits",
    7: "spirals of view directions",
    8: "frames and matrices",
    9: "values",
}


#: in which storage of depth, in bits, and in which types of array everything is given
BITS = (32, 16, 8)
INPUTS = ("float64", "float32")


def frame_of(origin: ArrayLike, a: ArrayLike, b: ArrayLike, f: ArrayLike, dtype: Any = np.float64) -> ParallelFrame:
    """Return the parallel frame of plain numbers, given as arrays of `dtype`."""
    return ParallelFrame(*(np.asarray(part, dtype) for part in (origin, a, b, f)))


#: frame of most cases: texels of one unit, depth along z
PLAIN = frame_of((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1))
SHAPE = (12, 15)
SIZE = (33, 27)


@dataclass(frozen=True, eq=False)
class Shot:
    """What is rendered, and from where.

    Attributes
    ----------
    source : a texture
    camera : Camera
    heights : (H, W) float64 or None
        Of a relief texture, before they were stored.
    """

    source: GridSource
    camera: Camera
    heights: Array | None = None

    def given_as(self, dtype: str) -> Shot:
        """Return the shot made anew from arrays of `dtype`: texels, frames, and cameras."""
        source, heights = self.source, self.heights
        if isinstance(source, ReliefTexture):
            assert heights is not None
            heights = heights.astype(dtype)
            source = ReliefTexture(_frame_as(source.frame, dtype), source.color.astype(dtype), heights)
        elif isinstance(source, DepthImage):
            camera = camera_as(source.camera, dtype)
            source = DepthImage(camera, source.color.astype(dtype), source.depth.astype(dtype))
        else:
            assert isinstance(source, LayeredDepthImage)
            frame: Any = source.frame
            frame = camera_as(frame, dtype) if isinstance(frame, Camera) else _frame_as(frame, dtype)
            depth, color, normal = (part.astype(dtype) for part in (source.depth, source.color, source.normal))
            source = LayeredDepthImage(frame, source.offsets, depth, color, normal, source.observers)
        return Shot(source, camera_as(self.camera, dtype), None if heights is None else heights.astype(np.float64))

    def stored(self, bits: int) -> Shot:
        """Return the shot with depth stored in 8 or 16 bits over its range, or as float32 (32)."""
        if bits == 32:
            return self
        levels = 2**bits - 1
        if isinstance(self.source, ReliefTexture):
            assert self.heights is not None
            heights = _in_steps(self.heights, levels)
            return Shot(ReliefTexture(self.source.frame, self.source.color, heights), self.camera, self.heights)
        source = self.source
        if isinstance(source, DepthImage):
            return Shot(DepthImage(source.camera, source.color, _in_steps(source.depth, levels)), self.camera)
        assert isinstance(source, LayeredDepthImage)
        depth = _in_steps(source.depth, levels)
        changed = LayeredDepthImage(source.frame, source.offsets, depth, source.color, source.normal, source.observers)
        return Shot(changed, self.camera)

    def surface(self) -> Surface:
        """Return the surface as stored."""
        return build_surface(self.source)

    def meant(self) -> Surface:
        """Return the surface before it was stored."""
        return build_surface(self.source, self.heights)

    def step(self, bits: int) -> float:
        """Return the step of depth in scene units when stored in `bits` bits; 0 for float32."""
        if bits == 32:
            return 0.0
        depth = self.heights if isinstance(self.source, ReliefTexture) else self.source.depth  # type: ignore[union-attr]
        assert depth is not None
        some = np.asarray(depth, np.float64)[np.isfinite(depth)]
        return float(np.ptp(some)) / (2**bits - 1) if len(some) else 0.0


def _frame_as(frame: ParallelFrame, dtype: str) -> ParallelFrame:
    return ParallelFrame(*(part.astype(dtype) for part in (frame.origin, frame.a, frame.b, frame.f)))


def camera_as(camera: Camera, dtype: str) -> Camera:
    """Return the camera made anew from arrays of `dtype`."""
    return Camera(camera.K.astype(dtype), camera.cam_from_world.astype(dtype), camera.width, camera.height)


def _in_steps(depth: Array, levels: int) -> Array:
    depth = np.asarray(depth, np.float64)
    some = depth[np.isfinite(depth)]
    if not len(some) or np.ptp(some) == 0.0:
        return depth
    low, step = some.min(), np.ptp(some) / levels
    return low + np.rint((depth - low) / step) * step


@dataclass(frozen=True)
class Case:
    """A picture that is compared with the oracle.

    Attributes
    ----------
    name : str
        Unique, words joined by "-".
    group : int
    what : str
        What is hard about it.
    build : callable
        Returns the shot.
    colors_tie : str
        Why no renderer can be held to the colours; empty = they are compared.
    """

    name: str
    group: int
    what: str
    build: Callable[[], Shot]
    colors_tie: str = ""


@dataclass(frozen=True)
class Refusal:
    """Something that no texture, frame or camera may be made of: `build(dtype)` must raise an `IbrError`."""

    name: str
    group: int
    what: str
    build: Callable[[str], object]


@dataclass(frozen=True)
class SpiralCase:
    """View-dependent colour looked up in a spiral of directions of density `k`, seen from `direction` (yaw, pitch
    degrees).

    `zero` is the code of no residual; residuals in linear light must not heed it.
    """

    name: str
    group: int
    what: str
    k: float
    direction: tuple[float, float]
    zero: int = 0


@dataclass(frozen=True, eq=False)
class MeshShot:
    """A relief-mapped mesh and where it is seen from; `meant`: its heights (H, W) float64 before they were stored."""

    source: ReliefMesh
    camera: Camera
    meant: Array

    def given_as(self, dtype: str) -> MeshShot:
        """Return the shot made anew from arrays of `dtype`."""
        source, meant = self.source, self.meant.astype(dtype)
        parts = {
            name: value.astype(dtype)
            for name in ("uv", "back", "color", "normal", "normals", "tangents")
            if (value := getattr(source, name)) is not None
        }
        mesh = Mesh(source.mesh.vertices.astype(dtype), source.mesh.faces)
        made = replace(source, mesh=mesh, height=meant, **parts)
        return MeshShot(made, camera_as(self.camera, dtype), meant.astype(np.float64))


@dataclass(frozen=True)
class MeshCase:
    """A picture of a relief-mapped mesh that is compared with float64 brute force; fields as those of `Case`."""

    name: str
    group: int
    what: str
    build: Callable[[], MeshShot]


@dataclass(frozen=True)
class CompositeCase:
    """A picture of several maps; the shots that `build` returns share a camera. Fields as those of `Case`."""

    name: str
    group: int
    what: str
    build: Callable[[], list[Shot]]
    colors_tie: str = ""


@dataclass(frozen=True, eq=False)
class SceneShot:
    """A scene of copies with the slices of its parts, from where it is seen, and exact samples along a pixel's side."""

    source: PrerenderedScene
    camera: Camera
    side: int = 8

    def given_as(self, dtype: str) -> SceneShot:
        """Return the shot with places of copies and camera given as arrays of `dtype`."""
        scene = self.source.scene
        parts = [
            replace(part, children=tuple(Instances(c.part, c.matrices.astype(dtype)) for c in part.children))
            for part in scene.parts.values()
        ]
        given = Scene(parts, scene.root, scene.lighting)
        return SceneShot(PrerenderedScene(given, self.source.library), camera_as(self.camera, dtype), self.side)


@dataclass(frozen=True)
class CopiesCase:
    """A picture of a scene of copies that is compared with all of them taken apart; fields as those of `Case`."""

    name: str
    group: int
    what: str
    build: Callable[[], SceneShot]
    colors_tie: str = ""


AnyCase = Case | Refusal | SpiralCase | MeshCase | CompositeCase | CopiesCase


def relief(frame: ParallelFrame, heights: Any, camera: Camera, color: Any = None) -> Shot:
    """Return the shot of a relief texture with coloured texels."""
    heights = np.asarray(heights, np.float64)
    return Shot(ReliefTexture(frame, colors(heights.shape) if color is None else color, heights), camera, heights)


def colors(shape: Sequence[int]) -> Array:
    """(H, W, 3) float64 smooth colours that differ in every texel."""
    y, x = np.mgrid[: shape[0], : shape[1]]
    return np.stack([0.5 + 0.4 * np.sin(0.7 * x), 0.5 + 0.4 * np.cos(0.5 * y), 0.2 + 0.6 * ((x + y) % 5) / 4], axis=-1)


def rough(shape: tuple[int, int] = SHAPE, height: float = 2.0, seed: int = 1) -> Array:
    """(H, W) float64 heights between 0 and `height`: waves and noise."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[: shape[0], : shape[1]]
    waves = 0.5 + 0.25 * np.sin(0.8 * x + 0.3) + 0.25 * np.cos(0.9 * y)
    return height * (0.7 * waves + 0.3 * rng.random(shape))


def look(eye: Any, target: Any, fov: float = 45.0, size: tuple[int, int] = SIZE, up: Any = (0, 0, 1)) -> Camera:
    """Return a camera of few pixels."""
    return Camera.look_at(eye, target, up, fov, *size)
