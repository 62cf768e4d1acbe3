"""Image-based surfaces without view dependence: relief textures, depth images, layered depth images."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ibrpipe.errors import ShapeError, ValueRangeError
from ibrpipe.types.arrays import Array, check_color, check_depth, contiguous, numbers_of
from ibrpipe.types.camera import Camera, ParallelFrame


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

    def __repr__(self) -> str:
        """Return the size."""
        return f"ReliefTexture({self.height.shape[1]} x {self.height.shape[0]})"

    def __post_init__(self) -> None:
        color, height = contiguous("color", self.color, np.float32, 3), contiguous("height", self.height, np.float32, 2)
        if color.shape != (*height.shape, 3) or height.size == 0:
            raise ShapeError(f"color must be (H, W, 3) for height (H, W), got {color.shape} and {height.shape}")
        if np.isinf(height).any():
            raise ValueRangeError("height holds infinity; use NaN for transparent texels")
        check_depth("height", height)
        check_color(color)
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

    def __repr__(self) -> str:
        """Return the size and where it was taken."""
        return f"DepthImage({self.camera.width} x {self.camera.height}, at {numbers_of(self.camera.center)})"

    def __post_init__(self) -> None:
        shape = (self.camera.height, self.camera.width)
        color, depth = contiguous("color", self.color, np.float32, 3), contiguous("depth", self.depth, np.float32, 2)
        if depth.shape != shape or color.shape != (*shape, 3):
            raise ShapeError(f"color and depth must be {shape}, got {color.shape[:2]} and {depth.shape}")
        depth = np.where(np.isposinf(depth), np.float32(np.nan), depth)
        if (depth <= 0).any():
            raise ValueRangeError("depth must be positive in front of the camera; use +inf where nothing is seen")
        check_depth("depth", depth)
        check_color(color)
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
    coverage : (S,) float32 or None
        Share of its texel that the surface of a sample fills, above 0 and up to 1; None = all of it everywhere.
    """

    frame: ParallelFrame | Camera
    offsets: Array
    depth: Array
    color: Array
    normal: Array
    observers: Array | None = None
    coverage: Array | None = None

    def __repr__(self) -> str:
        """Return size, samples and kind of projection."""
        projection = "parallel" if isinstance(self.frame, ParallelFrame) else "perspective"
        return f"LayeredDepthImage({self.size_in_words}, {projection})"

    def __post_init__(self) -> None:
        offsets = contiguous("offsets", self.offsets, np.int64, 2)
        depth = contiguous("depth", self.depth, np.float32, 1)
        color, normal = contiguous("color", self.color, np.float32, 2), contiguous("normal", self.normal, np.float32, 2)
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
        check_depth("depth", depth)
        starts = np.zeros(len(depth) + 1, bool)
        starts[offsets[:, :-1].ravel()] = True
        if len(depth) > 1 and (np.diff(depth)[~starts[1:-1]] < 0).any():
            raise ValueRangeError("depths must ascend within every pixel; sort the samples")
        if isinstance(self.frame, Camera):
            if (self.frame.height, self.frame.width) != (height, width):
                raise ShapeError(f"offsets are for {width} x {height} pixels but the camera is another size")
            if (depth <= 0).any():
                raise ValueRangeError("depth must be positive in front of the camera")
        check_color(color)
        for name, value in (("offsets", offsets), ("depth", depth), ("color", color), ("normal", normal)):
            object.__setattr__(self, name, value)
        if self.observers is not None:
            object.__setattr__(self, "observers", contiguous("observers", self.observers, np.int32, 1))
            if self.observers.shape != depth.shape:
                raise ShapeError(f"observers must be ({len(depth)},), one a sample, got {self.observers.shape}")
        if self.coverage is not None:
            coverage = contiguous("coverage", self.coverage, np.float32, 1)
            if coverage.shape != depth.shape:
                raise ShapeError(f"coverage must be ({len(depth)},), one a sample, got {coverage.shape}")
            if not ((coverage > 0) & (coverage <= 1)).all():
                raise ValueRangeError("coverage of a sample is not above 0 and up to 1; leave out samples without any")
            object.__setattr__(self, "coverage", coverage)

    @property
    def size_in_words(self) -> str:
        """Pixels and samples."""
        return f"{self.shape[1]} x {self.shape[0]}, {len(self.depth)} samples"

    @property
    def shape(self) -> tuple[int, int]:
        """(H, W) in texels."""
        return self.offsets.shape[0], self.offsets.shape[1] - 1
