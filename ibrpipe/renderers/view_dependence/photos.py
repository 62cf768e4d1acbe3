"""Pictures of surfaces whose colours come from kept photos: an unstructured lumigraph (buehler2001).

Which photos see a place is decided by the surface that is drawn: it is rendered once from the place of every photo.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from ibrpipe.core.appearance.photo_picture import draw_photos
from ibrpipe.core.color import srgb_decode
from ibrpipe.errors import RendererError
from ibrpipe.renderers.scene import Scene
from ibrpipe.renderers.view_dependence.component import Picture
from ibrpipe.renderers.view_dependence.mirror import matrix
from ibrpipe.types import Array, Camera, LayeredDepthImage, Texture
from ibrpipe.types.kept_photos import Blend, KeptPhotos, PhotoBlend

#: least cosine between normal and photo, and how far depths may differ, pixels: as where diffuse colours are made
RULES = (0.05, 2.0)
#: entries of the table from display code to linear light
CODES = 4096
#: photos no farther from the eye than this share of the distance to the middle of all photos are of its own place
SAME = 1e-6


@dataclass(frozen=True, eq=False)
class Tables:
    """Kept photos of all textures.

    Attributes
    ----------
    kept : KeptPhotos
    active : tuple of bool, one per texture
    normals : tuple of (S, 3) float32 or None, of every texture's samples
    """

    kept: KeptPhotos
    active: tuple[bool, ...]
    normals: tuple[Array | None, ...]
    made: dict[Scene, PackedPhotos] = field(default_factory=dict)

    @property
    def bytes(self) -> int:
        """Bytes held beyond the textures."""
        return self.kept.bytes + sum(each.bytes for each in self.made.values())

    def of(self, scene: Scene) -> PackedPhotos:
        """Return what pictures of `scene` need, made with the first of them."""
        if scene not in self.made:
            self.made[scene] = _packed(self, scene)
        return self.made[scene]


@dataclass(frozen=True, eq=False)
class PackedPhotos:
    """Photos as the kernel takes them, with the depth of a scene in each.

    Attributes
    ----------
    arrays : tuple
        Projections (P, 3, 4), centres (P, 3), sizes (P, 2), first pixels (P,), codes (T, 3) uint8, depth (T,) float32
        along the photo's z (+inf = none), mask (T,) uint8.
    normals : (S, 3) float32; NaN where none is known
    active : (F,) bool, layered images that take their colours from photos
    poses : (F, 4, 4) float64, homogeneous field coordinates from world
    table : (CODES,) float32, linear light of codes
    blend : Blend
    own : bool, whether photos are asked in pictures from their own place
    """

    arrays: tuple[Array, ...]
    normals: Array
    active: Array
    poses: Array
    table: Array
    blend: Blend
    own: bool

    @property
    def bytes(self) -> int:
        """Bytes held, without the codes, which are a copy of the photos'."""
        return sum(array.nbytes for array in (*self.arrays, self.normals, self.table))

    def draw(self, picture: Picture) -> Mapping[str, int]:
        """Colour a picture; tell how many pixels asked photos, and how many of them no photo sees."""
        camera = picture.camera
        view = (np.ascontiguousarray(camera.world_from_pixel), camera.center, *picture.places.arrays)
        counts, how = np.zeros((len(picture.depth), 2), np.int64), self.blend
        draw_photos(
            (picture.depth, picture.ids, picture.known), picture.color, view,
            (picture.scene.records[0], self.normals, self.active), self.poses, self._asked(camera), how.photos,
            np.array([*RULES, how.falloff, how.sharpness]), self.table, counts,
        )  # fmt: skip
        asked, seen = (int(each) for each in counts.sum(axis=0))
        return {"from_photos": seen, "without_photo": asked - seen}

    def _asked(self, camera: Camera) -> tuple[Array, ...]:
        """Return the photos that a picture from `camera` may ask."""
        if self.own:
            return self.arrays
        projection, centers, sizes, *rest = self.arrays
        scale = np.linalg.norm(centers - centers.mean(axis=0), axis=1).max() or 1.0
        same = np.linalg.norm(centers - camera.center, axis=1) <= SAME * scale
        return projection, centers, np.where(same[:, None], 0, sizes).astype(np.int32), *rest


class PhotosDrawer:
    """The kind "photos" as the renderers draw it."""

    def prepare(self, textures: Sequence[object]) -> Tables:
        """Find the photos, and which textures ask them.

        Raises
        ------
        RendererError
            Textures keep different photos.
        """
        parts = [each.component(PhotoBlend.kind) if isinstance(each, Texture) else None for each in textures]
        kept = {id(part.photos): part.photos for part in parts if isinstance(part, PhotoBlend)}
        if len(kept) != 1:
            raise RendererError(f"textures keep {len(kept)} sets of photos; render those of one asset")
        layers = [each.layers if isinstance(each, Texture) else each for each in textures]
        normals = tuple(each.normal if isinstance(each, LayeredDepthImage) else None for each in layers)
        return Tables(next(iter(kept.values())), tuple(part is not None for part in parts), normals)

    def add(self, tables: Tables, picture: Picture) -> Mapping[str, int]:
        """Replace colours where photos see the surface; tell how many pixels these are."""
        return tables.of(picture.scene).draw(picture)


def _packed(tables: Tables, scene: Scene) -> PackedPhotos:
    from ibrpipe.renderers.ldi.renderer import find_hits  # here: that module draws components

    kept, cameras = tables.kept, [photo.camera for photo in tables.kept.photos]
    sizes = np.array([(camera.height, camera.width) for camera in cameras], np.int32)
    ends = np.cumsum(sizes.astype(np.int64).prod(axis=1))
    fields = scene.patches
    normals = [tables.normals[number] for number, _ in fields]
    unknown = [np.full((len(image.color), 3), np.nan, np.float32) for _, image in fields]
    arrays = (
        np.stack([camera.pixel_from_world for camera in cameras]),
        np.stack([camera.center for camera in cameras]),
        sizes,
        ends - sizes.astype(np.int64).prod(axis=1),
        np.concatenate([photo.codes.reshape(-1, 3) for photo in kept.photos]),
        np.concatenate([find_hits(scene, camera).depth.ravel() for camera in cameras]),
        np.concatenate([photo.shown.ravel() for photo in kept.photos]).astype(np.uint8),
    )
    return PackedPhotos(
        arrays,
        np.concatenate([none if own is None else own for own, none in zip(normals, unknown, strict=True)]),
        np.array([tables.active[number] for number, _ in fields]),
        np.stack([matrix(image.pose) for _, image in fields]),
        srgb_decode(np.linspace(0.0, kept.top, CODES)).astype(np.float32),
        kept.blend,
        kept.own,
    )
