"""Kept photos on disk: `photos.zip` in the asset's folder, with a picture and a mask per photo, and `photos.json`.

Pictures are AVIF, or PNG without losses; any zip tool and picture viewer opens them. What does not show the object is
continued smoothly, so that it costs few bytes and coding does not ring at outlines; masks say where that is.
"""

from __future__ import annotations

import io
import json
import os
import zipfile
import zlib
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from ibrpipe.errors import FormatError, MissingFileError, ResourceError
from ibrpipe.io.components import Component, SharedFiles
from ibrpipe.io.layer_pictures.avif import QUICK, decode_avif, encode_avif
from ibrpipe.io.layers import frame_as_json, frame_from_json
from ibrpipe.io.residuals import continue_smoothly
from ibrpipe.io.untrusted.boundary import told
from ibrpipe.types import Array, Camera
from ibrpipe.types.kept_photos import MOST_PHOTOS, Blend, KeptPhoto, KeptPhotos, PhotoBlend

NAME = "photos.zip"
SCHEMA = 1
#: no header has more bytes, no photo and not all of them together more pixels
MOST_HEADER, MOST_PIXELS = 1 << 24, 1 << 30
_DATE = (1980, 1, 1, 0, 0, 0)
_REMEDY = "copy the asset again"


class PhotosFiles(SharedFiles):
    """The kind "photos" in asset folders: all bytes are in what is shared."""

    def write(self, component: PhotoBlend, folder: Path, quality: int) -> Mapping[str, Any]:
        """Write nothing: a texture only says that it asks the photos."""
        return {}

    def read(self, entry: Component, root: Path, shared: Any) -> PhotoBlend:
        """Return the component of photos that are read."""
        if not isinstance(shared, KeptPhotos):
            raise FormatError(f"{root}: a texture asks photos but the asset keeps none; {_REMEDY}")
        return PhotoBlend(shared)

    def write_shared(self, shared: KeptPhotos, folder: Path, quality: int) -> Mapping[str, Any]:
        """Write all photos."""
        return self.recode_shared(shared, folder, quality, QUICK)

    def recode_shared(self, shared: KeptPhotos, folder: Path, quality: int, speed: int) -> Mapping[str, Any]:
        """Write all photos at a quality; 100 is lossless."""
        write_photos(shared, folder / NAME, quality, speed)
        return {"file": NAME}

    def read_shared(self, entry: Component, root: Path) -> KeptPhotos:
        """Read all photos."""
        if entry.file is None:
            raise FormatError(f"{root}: asset.json names no file of the photos that are kept; {_REMEDY}")
        return read_photos(root / entry.file)


def write_photos(kept: KeptPhotos, path: Path, quality: int = 100, speed: int = QUICK) -> None:
    """Write `photos.zip`.

    Parameters
    ----------
    quality : int
        AVIF's, 1 to 99; 100 = PNG, lossless.
    speed : int
        As `ibrpipe.io.layer_pictures.avif.encode_avif` takes it.

    Raises
    ------
    ResourceError
        The file cannot be written.
    """
    header = {
        "schema": SCHEMA,
        "top": kept.top,
        "blend": asdict(kept.blend),
        "encoding": "png" if quality >= 100 else "avif",
        "cameras": [frame_as_json(photo.camera) for photo in kept.photos],
    }

    def coded(photo: KeptPhoto) -> bytes:
        picture = continue_smoothly(photo.codes, photo.shown)
        return _png(picture) if quality >= 100 else encode_avif(picture, quality, speed)

    path.parent.mkdir(parents=True, exist_ok=True)
    try:
        with ThreadPoolExecutor(os.cpu_count() or 1) as pool, zipfile.ZipFile(path, "w") as archive:
            _add(archive, "photos.json", json.dumps(header).encode(), zipfile.ZIP_DEFLATED)
            for number, (photo, data) in enumerate(zip(kept.photos, pool.map(coded, kept.photos), strict=True)):
                _add(archive, _picture(number, header["encoding"]), data)
                if not photo.shown.all():
                    _add(archive, _mask(number), zlib.compress(np.packbits(photo.shown).tobytes(), 9))
    except OSError as error:
        raise ResourceError(f"{path}: cannot write: {error.strerror or error}") from error


def _add(archive: zipfile.ZipFile, name: str, data: bytes, packing: int = zipfile.ZIP_STORED) -> None:
    archive.writestr(zipfile.ZipInfo(name, _DATE), data, packing)


def _picture(number: int, encoding: object) -> str:
    return f"{number:04d}.{encoding}"


def _mask(number: int) -> str:
    return f"{number:04d}.mask"


def read_photos(path: Path) -> KeptPhotos:
    """Read `photos.zip`.

    Raises
    ------
    MissingFileError
        There is no such file.
    FormatError
        It is damaged, or of another schema version.
    """
    if not path.is_file():
        raise MissingFileError(f"{path}: no such file; it should hold the photos that an asset keeps; {_REMEDY}")
    with told(path, _REMEDY), zipfile.ZipFile(path) as archive:
        header = _header(archive)
        cameras, blend = _cameras(header["cameras"]), Blend(**header["blend"])
        names = set(archive.namelist())
        pictures = [_read(archive, _picture(number, header["encoding"]), MOST_HEADER) for number in range(len(cameras))]
        masks = [
            _read(archive, _mask(number), MOST_HEADER) if _mask(number) in names else None
            for number in range(len(cameras))
        ]
        read_one = decode_avif if header["encoding"] == "avif" else _from_png

        def photo(number: int) -> KeptPhoto:
            camera = cameras[number]
            shape = (camera.height, camera.width)
            return KeptPhoto(camera, read_one(pictures[number], (*shape, 3)), _shown(masks[number], shape))

        try:
            with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
                photos = tuple(pool.map(photo, range(len(cameras))))
        except FormatError as error:
            raise ValueError(error) from error
        return KeptPhotos(photos, header["top"], blend)


def _header(archive: zipfile.ZipFile) -> dict[str, Any]:
    header: dict[str, Any] = json.loads(_read(archive, "photos.json", MOST_HEADER))
    if header["schema"] != SCHEMA:
        raise FormatError(f"{archive.filename}: photos of schema {header['schema']}, this version reads {SCHEMA}")
    if header["encoding"] not in ("avif", "png"):
        raise ValueError(f"pictures are said to be {header['encoding']!r}")
    if not all(type(value) in (int, float) for value in (header["top"], *header["blend"].values())):
        raise ValueError("top and what tells of the blend must be numbers")
    return header


def _read(archive: zipfile.ZipFile, name: str, most: int) -> bytes:
    """Return a part that unpacks to at most `most` bytes, or is not packed."""
    entry = archive.getinfo(name)
    if entry.compress_type != zipfile.ZIP_STORED and entry.file_size > most:
        raise ValueError(f"{name} unpacks to {entry.file_size} bytes")
    return archive.read(entry)


def _cameras(stated: Sequence[dict[str, Any]]) -> list[Camera]:
    if not 1 <= len(stated) <= MOST_PHOTOS:
        raise ValueError(f"it holds {len(stated)} photos, expected 1 to {MOST_PHOTOS}")
    cameras = [frame_from_json(each) for each in stated]
    if not all(isinstance(camera, Camera) for camera in cameras):
        raise ValueError("a photo has no camera")
    found = [camera for camera in cameras if isinstance(camera, Camera)]
    if sum(camera.width * camera.height for camera in found) > MOST_PIXELS:
        raise ValueError("its photos claim too many pixels")
    return found


def _shown(mask: bytes | None, shape: tuple[int, int]) -> Array:
    """Which pixels show the object; no mask = all."""
    pixels = shape[0] * shape[1]
    if mask is None:
        return np.ones(shape, bool)
    wanted = -(-pixels // 8)
    unpacking = zlib.decompressobj()
    bits = unpacking.decompress(mask, wanted + 1)
    if len(bits) != wanted:
        raise ValueError(f"a mask holds {len(bits)} bytes, {wanted} belong there")
    return np.unpackbits(np.frombuffer(bits, np.uint8), count=pixels).reshape(shape).astype(bool)


def _png(picture: Array) -> bytes:
    from PIL import Image

    buffer = io.BytesIO()
    Image.fromarray(picture).save(buffer, "PNG", compress_level=6)
    return buffer.getvalue()


def _from_png(data: bytes, shape: tuple[int, ...]) -> Array:
    from PIL import Image

    image = Image.open(io.BytesIO(data), formats=("PNG",))
    if image.size != (shape[1], shape[0]) or image.mode != "RGB":
        raise ValueError(f"a picture is {image.mode} {image.size}, not RGB {(shape[1], shape[0])}")
    return np.asarray(image)
