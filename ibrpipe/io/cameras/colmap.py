"""COLMAP models, text or binary, old or with rigs and frames, as lenses and poses.

Only cameras and images are read. Newer models add rigs and frames, but their images still state the pose of every photo
of its own, so the same two files serve. pycolmap's reader is not used: a truncated file makes it abort the process, or
come back with invented numbers.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from ibrpipe.errors import CaptureError, FormatError, IbrError
from ibrpipe.io.cameras.lenses import Lens, model_by_id
from ibrpipe.io.cameras.shots import Shot
from ibrpipe.io.untrusted.boundary import reader
from ibrpipe.types import Array

#: Where models may be inside a capture folder, best first: in folders of their own, or there itself
FOLDERS = ("sparse", "colmap/sparse")
_IMAGE_LINE = "ID QW QX QY QZ TX TY TZ CAMERA_ID NAME"
_POINT_BYTES = 24
#: words of a line that tell whether it holds points; names of photos come tenth
_LOOKED_AT = 30


def find_model(capture: Path) -> Path | None:
    """Folder of the COLMAP model inside a capture folder, that of most images where there are several, or None."""
    return next(iter(find_models(capture)), None)


def find_models(capture: Path) -> list[Path]:
    """Folders of all COLMAP models of the first place that holds any, that of most images first."""
    for name in FOLDERS:
        place = capture / name
        inside = sorted(path for path in place.iterdir() if is_model(path)) if place.is_dir() else []
        if len(inside) > 1:
            inside.sort(key=lambda path: (-image_count(path), len(path.name)))
        if inside:
            return inside
        if is_model(place):
            return [place]
    return []


def image_count(folder: Path) -> int:
    """Return the number of images of a COLMAP model; 0 where it is damaged."""
    try:
        return len(image_names(folder))
    except (IbrError, OSError):
        return 0


def is_model(folder: Path) -> bool:
    """Say whether a folder looks like a COLMAP model."""
    return any((folder / f"{stem}{suffix}").is_file() for stem in ("images", "cameras") for suffix in (".bin", ".txt"))


@reader("export the model again")
def read_model(folder: Path, images: Path) -> tuple[Shot, ...]:
    """Read all images of a COLMAP model.

    Parameters
    ----------
    folder : Path
        Holds cameras and images as .bin or .txt; the binary ones are taken where both exist.
    images : Path
        Folder that the image names are relative to.

    Returns
    -------
    tuple of Shot
        Sorted by name.

    Raises
    ------
    FormatError, CaptureError
        Files missing or damaged, an unknown camera model, a pose that is none, no image; with file and line.
    """
    suffix = ".bin" if (folder / "images.bin").is_file() else ".txt"
    for stem in ("cameras", "images"):
        if not (folder / f"{stem}{suffix}").is_file():
            raise FormatError(f"{folder}: {stem}{suffix} is missing; copy the whole COLMAP model")
    text = suffix == ".txt"
    lenses = dict((_cameras_text if text else _cameras_binary)(folder / f"cameras{suffix}"))
    source = folder / f"images{suffix}"
    shots = []
    for where, _, name, camera, numbers in (_images_text if text else _images_binary)(source):
        if camera not in lenses:
            raise FormatError(f"{where}: photo {name} names camera {camera}, which cameras{suffix} does not hold")
        shots.append(Shot(name, images / name, lenses[camera], _pose(numbers, f"{where}: the pose of {name}")))
    if not shots:
        raise CaptureError(f"{source}: the COLMAP model has no image with a pose; calibrate the photos first")
    return tuple(sorted(shots, key=lambda shot: shot.file))


def image_names(folder: Path) -> dict[int, str]:
    """Return the names of all images of a COLMAP model by their numbers; raises as `read_model`."""
    binary = folder / "images.bin"
    images = _images_binary(binary) if binary.is_file() else _images_text(folder / "images.txt")
    return {key: name for _, key, name, _, _ in images}


def _pose(numbers: tuple[float, ...], what: str) -> Array:
    """(3, 4) float64 from quaternion w x y z and translation."""
    if not all(map(math.isfinite, numbers)):
        raise CaptureError(f"{what} holds NaN or infinity; calibrate this photo again or remove it")
    length = math.hypot(*numbers[:4])
    if not length > 1e-9:
        raise CaptureError(f"{what} has the quaternion 0 0 0 0; expected a unit quaternion, remove the photo")
    w, x, y, z = (value / length for value in numbers[:4])
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w), numbers[4]],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w), numbers[5]],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y), numbers[6]],
        ]
    )


def _lens(where: str, model: str, params: tuple[float, ...], width: int, height: int) -> Lens:
    try:
        return Lens(model, params, width, height)
    except IbrError as error:
        raise CaptureError(f"{where}: {error}") from error


def text_lines(path: Path) -> list[tuple[str, str]]:
    """Lines that are no comments, each with the words that say where it is."""
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except UnicodeDecodeError as error:
        raise FormatError(f"{path}: is not UTF-8 text; export the model again") from error
    return [(f"{path}, line {n}", line.strip()) for n, line in enumerate(lines, 1) if not line.startswith("#")]


def _cameras_text(path: Path) -> Iterator[tuple[int, Lens]]:
    for where, line in text_lines(path):
        words = line.split()
        if not words:
            continue
        try:
            key, width, height = int(words[0]), int(words[2]), int(words[3])
            params = tuple(float(word) for word in words[4:])
        except (ValueError, IndexError) as error:
            raise FormatError(f"{where}: expected ID MODEL WIDTH HEIGHT PARAMS, got {line[:80]!r}") from error
        yield key, _lens(where, words[1], params, width, height)


def _images_text(path: Path) -> Iterator[tuple[str, int, str, int, tuple[float, ...]]]:
    """Every image takes two lines: itself, then its points (may be empty). Files without the second ones are read, too.

    Some scripts leave the lines of points out; what follows an image is told by its words, since points come in threes
    and are all numbers.
    """
    after_image = False
    for where, line in text_lines(path):
        if not line or (after_image and _is_points(line)):
            after_image = False
            continue
        words = line.split(maxsplit=9)
        try:
            key, name, camera = int(words[0]), words[9], int(words[8])
            numbers = tuple(float(word) for word in words[1:8])
        except (ValueError, IndexError) as error:
            raise FormatError(f"{where}: expected {_IMAGE_LINE}, got {line[:80]!r}") from error
        yield where, key, name, camera, numbers
        after_image = True


def _is_points(line: str) -> bool:
    """Say whether a line holds points of an image, X Y POINT3D_ID again and again."""
    words = line.split()
    try:
        numbers = [float(word) for word in words[:_LOOKED_AT]]
    except ValueError:
        return False
    return len(words) % 3 == 0 and all(number.is_integer() for number in numbers[2::3])


class Cursor:
    """Reads numbers one after the other and says where a file ends too early."""

    def __init__(self, path: Path) -> None:
        self.path, self.data, self.at = path, path.read_bytes(), 0

    def take(self, layout: str) -> tuple[Any, ...]:
        """Read little-endian values of a `struct` layout."""
        start = self.skip(struct.calcsize(f"<{layout}"))
        return struct.unpack_from(f"<{layout}", self.data, start)

    def skip(self, size: int) -> int:
        """Move on by `size` bytes; return where they start."""
        start, self.at = self.at, self.at + size
        if self.at > len(self.data):
            raise FormatError(
                f"{self.path}: the COLMAP model is truncated (it has {len(self.data)} bytes, at least {self.at} are "
                "expected); copy it again"
            )
        return start

    def word(self) -> str:
        """Read text that ends with a zero byte."""
        end = self.data.find(b"\0", self.at)
        start = self.skip((end if end >= 0 else len(self.data)) - self.at + 1)
        try:
            return self.data[start:end].decode("utf-8")
        except UnicodeDecodeError as error:
            raise FormatError(
                f"{self.path}: the COLMAP model is damaged (a name is not UTF-8); export it again"
            ) from error


def _cameras_binary(path: Path) -> Iterator[tuple[int, Lens]]:
    cursor = Cursor(path)
    for _ in range(cursor.take("Q")[0]):
        key, model, width, height = cursor.take("IiQQ")
        where = f"{path}, camera {key}"
        try:
            name, count = model_by_id(model)
        except CaptureError as error:
            raise CaptureError(f"{where}: {error}") from error
        yield key, _lens(where, name, cursor.take(f"{count}d"), width, height)


def _images_binary(path: Path) -> Iterator[tuple[str, int, str, int, tuple[float, ...]]]:
    cursor = Cursor(path)
    for _ in range(cursor.take("Q")[0]):
        key, *numbers, camera = cursor.take("I7dI")
        name = cursor.word()
        cursor.skip(cursor.take("Q")[0] * _POINT_BYTES)
        yield f"{path}, image {key}", key, name, camera, tuple(numbers)
