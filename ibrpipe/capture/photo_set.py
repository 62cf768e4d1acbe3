"""All photos of a capture in one packed set, ready for the kernels that ask which photos see a point."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from ibrpipe.core.appearance.diffuse import diffuse_colors
from ibrpipe.core.appearance.photo_blend import blend_photos
from ibrpipe.core.color import srgb_decode, srgb_encode
from ibrpipe.embree import MeshCaster
from ibrpipe.errors import CaptureError
from ibrpipe.io.views import View, load_view
from ibrpipe.progress import track
from ibrpipe.types import Array, Blend, Camera

#: smallest cosine between surface normal and direction to a photo for the photo to count as seeing the surface
COS_MIN = 0.05
#: how far a photo's depth map may differ from a point's depth, in pixel footprints on the surface
DEPTH_SLACK = 2.0
#: how photos are mixed in gong-yang, sec. 4.2
PUBLISHED = Blend()


@dataclass(frozen=True, eq=False)
class PhotoSet:
    """Packed photos: photo p owns pixels ``starts[p]`` to ``starts[p + 1]``, row-major.

    Attributes
    ----------
    cameras : tuple of Camera
    projection : (P, 3, 4) float64, pixels from world
    centers : (P, 3) float64, world
    sizes : (P, 2) int32, height and width
    starts : (P,) or (P + 1,) int64, first pixel of every photo
    code : (T, 3) float32, display code (sRGB curve, carried on above 1)
    depth : (T,) float32, of the mesh along camera z at pixel centres, +inf where the mesh is not hit
    mask : (T,) float32, coverage 0 to 1
    """

    cameras: tuple[Camera, ...]
    projection: Array
    centers: Array
    sizes: Array
    starts: Array
    code: Array
    depth: Array
    mask: Array

    @property
    def _arrays(self) -> tuple[Array, ...]:
        return self.projection, self.centers, self.sizes, self.starts, self.code, self.depth, self.mask

    def pixels_of(self, photo: int) -> slice:
        """Pixels of one photo."""
        first = int(self.starts[photo])
        return slice(first, first + int(np.prod(self.sizes[photo], dtype=np.int64)))

    def subset(self, photos: Sequence[int]) -> PhotoSet:
        """Some of the photos; pixels are shared, not copied."""
        chosen = list(photos)
        return PhotoSet(
            tuple(self.cameras[p] for p in chosen),
            self.projection[chosen],
            self.centers[chosen],
            self.sizes[chosen],
            self.starts[chosen],
            self.code,
            self.depth,
            self.mask,
        )

    def blend(self, points: Array, normals: Array, directions: Array, how: Blend = PUBLISHED) -> tuple[Array, Array]:
        """Colour surface points as seen from `directions` by the best four photos (gong-yang, sec. 4.2), or otherwise.

        Parameters
        ----------
        points : (N, 3) float64, world
        normals : (N, 3) float32, unit, outward
        directions : (N, 3) float64, unit, from the point toward the viewer

        Returns
        -------
        color : (N, 3) float32, linear; NaN where no photo sees the point
        count : (N,) int32, photos used, 0 to `how.photos`
        """
        code, count = self.blend_codes(points, normals, directions, how)
        return srgb_decode(code), count

    def blend_codes(
        self, points: Array, normals: Array, directions: Array, how: Blend = PUBLISHED
    ) -> tuple[Array, Array]:
        """Do as `blend`, but leave the colour (N, 3) in display code: for `code` that is signed, such as errors."""
        code, count = np.empty((len(points), 3), np.float32), np.empty(len(points), np.int32)
        points, normals = np.ascontiguousarray(points, np.float64), np.ascontiguousarray(normals, np.float32)
        directions = np.ascontiguousarray(directions, np.float64)
        rules = np.array([COS_MIN, DEPTH_SLACK, how.falloff, how.sharpness])
        blend_photos(points, normals, directions, self._arrays, how.photos, rules, code, count)
        return code, count

    def diffuse(self, points: Array, normals: Array, bins: int = 128, statistic: int = 0) -> tuple[Array, Array, Array]:
        """Reduce what all photos show of surface points to diffuse colours (gong-yang, sec. 4.1).

        Returns
        -------
        color : (N, 3) float32, linear; NaN where no photo sees the point
        spread : (N,) float32, mean absolute deviation of the observations, in display code (0 to 1)
        count : (N,) int32, photos used
        """
        color, spread = np.empty((len(points), 3), np.float32), np.empty(len(points), np.float32)
        count = np.empty(len(points), np.int32)
        points, normals = np.ascontiguousarray(points, np.float64), np.ascontiguousarray(normals, np.float32)
        top = max(1.0, float(self.code.max()))
        diffuse_colors(points, normals, self._arrays, COS_MIN, DEPTH_SLACK, top, bins, statistic, color, spread, count)
        return srgb_decode(color), spread, count


def load_photos(views: Sequence[View], caster: MeshCaster) -> PhotoSet:
    """Load all photos and cast the mesh into each.

    Memory is 20 bytes a pixel for all photos together (colour, depth, mask as float32).

    Raises
    ------
    CaptureError
        There are no photos.
    """
    if not views:
        raise CaptureError("the capture has no training photos; give at least two")
    return _packed(views, track(views, "photos"), caster)


def load_photo(view: View, caster: MeshCaster) -> PhotoSet:
    """Load one photo as a set of its own, to look at photos in turn; without progress, which is that of the loop."""
    return _packed([view], [view], caster)


def _packed(views: Sequence[View], loaded: Iterable[View], caster: MeshCaster) -> PhotoSet:
    """Pack views; `loaded` yields the same again."""
    cameras = tuple(view.camera for view in views)
    sizes = np.array([(c.height, c.width) for c in cameras], np.int32)
    starts = np.concatenate([[0], np.cumsum(sizes.astype(np.int64).prod(axis=1))])
    code, depth = np.empty((starts[-1], 3), np.float32), np.empty(starts[-1], np.float32)
    mask = np.empty(starts[-1], np.float32)
    for p, view in enumerate(loaded):
        own = slice(starts[p], starts[p + 1])
        pixels, coverage = load_view(view)
        code[own], mask[own] = srgb_encode(pixels, np.inf).reshape(-1, 3), coverage.ravel()
        depth[own] = caster.cast_camera(view.camera).t.ravel()
    return PhotoSet(
        cameras,
        np.stack([c.pixel_from_world for c in cameras]),
        np.stack([c.center for c in cameras]),
        sizes,
        starts,
        code,
        depth,
        mask,
    )
