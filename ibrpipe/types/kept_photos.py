"""Kept photos: a surface that takes its colours from the photos it was made of, blended anew for every view."""

from __future__ import annotations

import math
import operator
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import ClassVar

import numpy as np

from ibrpipe.errors import ShapeError, ValueRangeError
from ibrpipe.types.arrays import Array, contiguous
from ibrpipe.types.camera import Camera
from ibrpipe.types.view_dependence import ViewDependence

#: most photos that an asset keeps, and most that are blended at a place
MOST_PHOTOS, MOST_BLENDED = 4096, 8
#: fewest photos that decide a blend, and the greatest falloff and sharpness
LEAST_BLENDED, MOST_SHARP = 2, 2.0


@dataclass(frozen=True)
class Blend:
    """How photos that see a place are mixed (buehler2001).

    Attributes
    ----------
    photos : int
        Photos that a place asks at the most, the nearest by angle; the last is only the bar for the others.
    falloff : float
        0: a photo weighs as far as the cosine of its angle lies above the bar's (gong-yang, sec. 4.2). Else its weight
        is (1 - angle / bar) / angle^falloff.
    sharpness : float
        0: pixels are mixed bilinearly. Else by cubic convolution of parameter -sharpness (keys1981), which undoes some
        of the blur of mixing photos.

    Raises
    ------
    ValueRangeError
        A figure is out of bounds.
    """

    photos: int = 4
    falloff: float = 0.0
    sharpness: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "photos", operator.index(self.photos))
        if not LEAST_BLENDED <= self.photos <= MOST_BLENDED:
            raise ValueRangeError(f"{self.photos} photos are blended; it must be {LEAST_BLENDED} to {MOST_BLENDED}")
        for name in ("falloff", "sharpness"):
            object.__setattr__(self, name, float(getattr(self, name)))
            if not 0 <= getattr(self, name) <= MOST_SHARP:
                raise ValueRangeError(f"{name} is {getattr(self, name)}; it must lie in [0, {MOST_SHARP}]")


@dataclass(frozen=True, eq=False)
class KeptPhoto:
    """What one photo shows of the object, cut to that.

    Attributes
    ----------
    camera : Camera
        Of the cut picture.
    codes : (H, W, 3) uint8
        Display code (sRGB curve), 255 = `KeptPhotos.top`.
    shown : (H, W) bool
        Pixels that show the object; elsewhere codes mean nothing.

    Raises
    ------
    ShapeError
        Sizes differ.
    """

    camera: Camera
    codes: Array
    shown: Array

    def __post_init__(self) -> None:
        shape = (self.camera.height, self.camera.width)
        codes, shown = contiguous("codes", self.codes, np.uint8, 3), contiguous("shown", self.shown, np.bool_, 2)
        if codes.shape != (*shape, 3) or shown.shape != shape:
            raise ShapeError(
                f"codes {codes.shape} and shown {shown.shape} must be as large as the camera's picture, {shape}"
            )
        object.__setattr__(self, "codes", codes)
        object.__setattr__(self, "shown", shown)

    @property
    def bytes(self) -> int:
        """Bytes held in memory."""
        return self.codes.nbytes + self.shown.nbytes


@dataclass(frozen=True, eq=False)
class KeptPhotos:
    """Photos that all textures of an asset take their colours from.

    Attributes
    ----------
    photos : tuple of KeptPhoto
    top : float
        Display code that 255 stands for, 1 and more: above 1 is light beyond white.
    blend : Blend
        How those that see a place are mixed.
    own : bool
        Whether a photo is asked in a picture from its own place. Left out, pictures from there tell how views are
        predicted that no photo shows.

    Raises
    ------
    ShapeError, ValueRangeError
        There are no photos or too many, or figures out of bounds.
    """

    photos: tuple[KeptPhoto, ...]
    top: float = 1.0
    blend: Blend = field(default=Blend())
    own: bool = field(default=True, kw_only=True)

    def __repr__(self) -> str:
        """Return how many photos and pixels there are."""
        pixels = sum(photo.shown.size for photo in self.photos)
        return f"KeptPhotos({len(self.photos)} photos, {pixels} pixels, {self.blend.photos} blended)"

    def __post_init__(self) -> None:
        photos = tuple(self.photos)
        if not 1 <= len(photos) <= MOST_PHOTOS or not all(isinstance(photo, KeptPhoto) for photo in photos):
            raise ShapeError(f"photos must be 1 to {MOST_PHOTOS} KeptPhoto, got {len(photos)}")
        object.__setattr__(self, "photos", photos)
        object.__setattr__(self, "top", float(self.top))
        if not (math.isfinite(self.top) and 1 <= self.top <= 1e3):
            raise ValueRangeError(f"top is {self.top}; the greatest display code must lie in [1, 1000]")

    @property
    def bytes(self) -> int:
        """Bytes held in memory."""
        return sum(photo.bytes for photo in self.photos)

    @cached_property
    def predicting(self) -> KeptPhotos:
        """The same photos, none of which is asked in a picture from its own place."""
        return replace(self, own=False)


@dataclass(frozen=True, eq=False)
class PhotoBlend(ViewDependence):
    """A texture that shows, wherever photos see it, what the nearest of them by angle show (buehler2001).

    Attributes
    ----------
    photos : KeptPhotos
        Shared by all textures of the asset.
    """

    kind: ClassVar[str] = "photos"

    photos: KeptPhotos

    @property
    def shared(self) -> KeptPhotos:
        """The photos."""
        return self.photos

    @property
    def bytes(self) -> int:
        """Bytes held in memory, without the photos."""
        return 0

    def predicting(self) -> PhotoBlend:
        """Return the same without any photo in pictures from its own place."""
        return PhotoBlend(self.photos.predicting)
