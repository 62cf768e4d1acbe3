"""SIFT features of one photo, inside its mask, kept as one file per photo.

Source: lowe2004 by OpenCV; descriptors as arandjelovic2012 (RootSIFT). OpenCV's SIFT takes about a fifth of the time of
COLMAP's on a CPU, and its positions are as exact.
"""

from __future__ import annotations

import hashlib
import json
import math
import zipfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ibrpipe.calibration.job import PhotoEntry
from ibrpipe.core.color import srgb_encode
from ibrpipe.errors import FormatError
from ibrpipe.io.photos.exif import Exif, read_exif
from ibrpipe.io.photos.image_files import ImageHeader, read_stored
from ibrpipe.io.photos.images import read_coverage
from ibrpipe.types import Array

#: Least difference of Gaussians; where it finds fewer than `FEW` features, the second is tried
CONTRAST = (0.02, 0.006)
FEW = 1500
#: Pixels around the mask that filters may look at
MARGIN = 32
_NONE = (np.zeros((0, 4), np.float32), np.zeros((0, 128), np.uint8), np.zeros((0, 3), np.uint8))
#: Changes with the meaning of the stored files
VERSION = 2


@dataclass(frozen=True, eq=False)
class Features:
    """Features of one photo.

    Attributes
    ----------
    keypoints : (N, 4) float32
        x, y in pixels of the photo file (pixel (0, 0)'s centre at (0.5, 0.5)), size, angle in radians; strongest first.
    descriptors : (N, 128) uint8
    colors : (N, 3) uint8
        What the photo shows there, as coded in the file.
    width, height : int
        Of the photo file.
    exif : Exif
    covered : float
        Share of the photo inside its mask.
    """

    keypoints: Array
    descriptors: Array
    colors: Array
    width: int
    height: int
    exif: Exif
    covered: float


def features_of(photo: PhotoEntry, most: int, max_size: int, folder: Path) -> Features:
    """Return the features of a photo: from `folder` where an earlier run has left them, else found and left there.

    Parameters
    ----------
    photo : PhotoEntry
    most : int
        Features at the most.
    max_size : int
        Larger photos are searched at this many pixels along their longer side.
    folder : Path

    Raises
    ------
    FormatError, MissingFileError, CaptureError
        Photo or mask cannot be read, or do not fit each other.
    """
    path = folder / f"{_key(photo, most, max_size)}.npz"
    known = _read(path)
    if known is None:
        known = find_features(photo, most, max_size)
        part = path.with_suffix(".part")
        with part.open("wb") as target:
            exif = json.dumps([known.exif.focal, known.exif.lens, known.exif.gps])
            size = [known.width, known.height]
            np.savez(
                target,
                k=known.keypoints,
                d=known.descriptors,
                c=known.colors,
                size=size,
                exif=exif,
                covered=known.covered,
            )
        part.replace(path)
    return known


def find_features(photo: PhotoEntry, most: int, max_size: int) -> Features:
    """Read a photo and find its features; arguments and errors as `features_of`."""
    picture, mask = read_photo(photo)
    height, width = picture.shape[:2]
    exif = read_exif(Path(photo.image))
    top, bottom, left, right = _window(mask)
    covered = 1.0 if mask is None else float(mask.mean())
    if bottom <= top:
        return Features(*_NONE, width, height, exif, 0.0)
    window, factor = _shrunk(_grey(picture[top:bottom, left:right]), max_size / max(width, height))
    spots, descriptors = _search(window, CONTRAST[0], most if mask is None else 4 * most)
    if len(spots) < FEW:
        spots, descriptors = _search(window, CONTRAST[1], most if mask is None else 4 * most)
    spots[:, :2] = (spots[:, :2] + 0.5) / factor + (left, top)
    spots[:, 2] /= np.float32(factor.mean())
    kept = _inside(spots, mask, (width, height))
    kept = kept[np.lexsort([*spots[kept, :4].T, -spots[kept, 4]])][:most]
    keypoints = spots[kept, :4].astype(np.float32)
    colors = picture[keypoints[:, 1].astype(np.int64), keypoints[:, 0].astype(np.int64)]
    return Features(keypoints, descriptors[kept], colors, width, height, exif, covered)


def read_photo(photo: PhotoEntry) -> tuple[Array, Array | None]:
    """Read a photo as stored, coded in 8 bits, (H, W, 3) uint8, and its mask (H, W) bool; None = all of it counts."""
    pixels, header = read_stored(Path(photo.image))
    picture = _coded(pixels, header, Path(photo.image))
    mask: Array | None = None
    if photo.mask is not None:
        coverage = read_coverage(Path(photo.mask), False)
        if coverage.shape != picture.shape[:2]:
            found, wanted = coverage.shape[::-1], picture.shape[1::-1]
            raise FormatError(
                f"{photo.mask}: is {found[0]} x {found[1]} pixels but its photo is {wanted[0]} x {wanted[1]}; "
                "a mask has its photo's size"
            )
        mask = coverage > 0 if photo.mask_rule == "nonzero" else coverage >= 0.5
    elif photo.mask_from_alpha and header.has_alpha:
        alpha = pixels[:, :, header.channels.index("A")]
        mask = alpha >= (0.5 * np.iinfo(alpha.dtype).max if header.integer else 0.5)
    return picture, mask


def _coded(pixels: Array, header: ImageHeader, path: Path) -> Array:
    """Return colours as 8-bit codes: 16-bit files are shortened, linear ones scaled to their 99th percentile."""
    colours = pixels[:, :, :3] if pixels.shape[2] >= 3 else np.repeat(pixels[:, :, :1], 3, axis=2)
    if header.integer:
        if colours.dtype != np.uint8:
            colours = (colours / (np.iinfo(colours.dtype).max / 255.0)).round().astype(np.uint8)
        return np.ascontiguousarray(colours)
    if not np.isfinite(colours).all():
        raise FormatError(f"{path}: the photo holds NaN or infinite pixels; repair it")
    white = float(np.percentile(colours, 99.0))
    coded = srgb_encode(np.clip(colours.astype(np.float32) / np.float32(white if white > 0 else 1.0), 0.0, 1.0))
    return np.rint(255.0 * coded).astype(np.uint8)


def coded_grey(pixels: Array, header: ImageHeader, path: Path) -> Array:
    """Return the pixels of a photo file as 8-bit grey, (H, W) uint8."""
    return _grey(_coded(pixels, header, path))


def _grey(picture: Array) -> Array:
    import cv2

    return np.asarray(cv2.cvtColor(np.ascontiguousarray(picture), cv2.COLOR_RGB2GRAY))


def _window(mask: Array | None) -> tuple[int, int, int, int]:
    """Rows and columns around the mask; empty where it keeps nothing."""
    if mask is None:
        return 0, 1 << 30, 0, 1 << 30
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if not len(rows):
        return 0, 0, 0, 0
    top, left = max(0, rows[0] - MARGIN), max(0, columns[0] - MARGIN)
    return top, rows[-1] + 1 + MARGIN, left, columns[-1] + 1 + MARGIN


def _shrunk(window: Array, scale: float) -> tuple[Array, Array]:
    """Return the window at `scale` where that is smaller, and its size over the former one, (x, y) float64."""
    import cv2

    if scale >= 1.0:
        return window, np.ones(2)
    height, width = window.shape
    size = max(1, round(width * scale)), max(1, round(height * scale))
    return cv2.resize(window, size, interpolation=cv2.INTER_AREA), np.array([size[0] / width, size[1] / height])


def _search(grey: Array, contrast: float, most: int) -> tuple[Array, Array]:
    """SIFT in a picture.

    Returns
    -------
    spots : (N, 5) float64
        x, y counted from the centre of pixel (0, 0), size, angle in radians, response.
    descriptors : (N, 128) uint8
    """
    import cv2

    sift = cv2.SIFT_create(  # type: ignore[attr-defined]
        most, nOctaveLayers=3, contrastThreshold=contrast, edgeThreshold=16, sigma=1.6, enable_precise_upscale=True
    )
    found, vectors = sift.detectAndCompute(grey, None)
    if not found:
        return np.zeros((0, 5)), np.zeros((0, 128), np.uint8)
    spots = np.array([(*spot.pt, spot.size / 2.0, math.radians(spot.angle), spot.response) for spot in found])
    roots = np.sqrt(vectors / np.maximum(vectors.sum(axis=1, keepdims=True), 1e-12))
    return spots, np.clip(np.rint(512.0 * roots), 0, 255).astype(np.uint8)


def _inside(spots: Array, mask: Array | None, size: tuple[int, int]) -> Array:
    """Indices of the spots inside the picture and its mask."""
    column, row = np.floor(spots[:, :2]).astype(np.int64).T
    kept = (column >= 0) & (row >= 0) & (column < size[0]) & (row < size[1])
    if mask is not None:
        kept[kept] = mask[row[kept], column[kept]]
    return np.flatnonzero(kept)


def _key(photo: PhotoEntry, most: int, max_size: int) -> str:
    """Hash of all that decides a photo's features; files count by place, size and time of change."""
    parts: list[object] = [VERSION, most, max_size, photo.mask_from_alpha, photo.mask_rule]
    for name in (photo.image, photo.mask):
        if name is not None:
            state = Path(name).stat()
            parts += [name, state.st_size, state.st_mtime_ns]
    return hashlib.blake2b(json.dumps(parts).encode(), digest_size=16).hexdigest()


def _read(path: Path) -> Features | None:
    if not path.is_file():
        return None
    try:
        with np.load(path) as stored:
            focal, lens, gps = json.loads(str(stored["exif"]))
            exif = Exif(focal, lens, None if gps is None else (gps[0], gps[1], gps[2]))
            width, height = (int(value) for value in stored["size"])
            return Features(stored["k"], stored["d"], stored["c"], width, height, exif, float(stored["covered"]))
    except (KeyError, ValueError, OSError, zipfile.BadZipFile):
        return None
