"""Residual images of one texture in one zip: a picture per spiral direction at its own size, and `residuals.json`.

8-bit residuals are WebP pictures (lossless, or lossy at a stated quality) whose alpha says where a texel is valid, or,
coded compactly, one AVIF picture of all directions; linear residuals are half-float NumPy arrays. Any zip tool and
picture viewer opens them. Texels that are not valid carry smoothly continued colours, so that they cost few bytes and
lossy coding does not ring at silhouettes.
"""

from __future__ import annotations

import io
import json
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from ibrpipe.errors import FormatError, MissingFileError, ResourceError
from ibrpipe.io.components import Component, SampleFiles
from ibrpipe.io.layer_pictures.avif import LONGEST, QUICK
from ibrpipe.io.layers import frame_as_json, frame_from_json
from ibrpipe.io.residual_atlas import pack_images, unpack_images
from ibrpipe.io.untrusted.arrays import read_npy
from ibrpipe.io.untrusted.boundary import told
from ibrpipe.types import Array, LayeredDepthImage, ParallelFrame, SpiralResiduals

NAME = "residuals.zip"
SCHEMA = 1
#: bytes of the header of an array, at the most
_NPY_HEADER = 1 << 14
#: no header has more bytes, no texture more texels in all its images
MOST_HEADER, MOST_TEXELS = 1 << 24, 1 << 30
_DATE = (1980, 1, 1, 0, 0, 0)


def write_residuals(
    residuals: SpiralResiduals, folder: Path, quality: int = 100, compact: bool = False, speed: int = QUICK
) -> Path:
    """Write `residuals.zip` into `folder`.

    Parameters
    ----------
    quality : int
        Of 8-bit residuals, 1 to 100: WebP's, 100 is lossless; AVIF's, where they are written compactly.
    compact : bool
        Write 8-bit residuals as one AVIF picture without saying which texels are valid; not at quality 100.
    speed : int
        As `ibrpipe.io.layer_pictures.avif.encode_avif` takes it.

    Raises
    ------
    ResourceError
        The file cannot be written.
    """
    path, atlas = folder / NAME, None
    if compact and quality < 100 and residuals.texels.dtype == np.uint8:
        atlas = pack_images(residuals.texels, residuals.valid, residuals.sizes, residuals.zero, quality, speed)
    header = {
        "schema": SCHEMA,
        "rectangle": frame_as_json(residuals.rectangle),
        "k": residuals.k,
        "closed": residuals.closed,
        "zero": residuals.zero,
        "encoding": "avif" if atlas is not None else "8bit" if residuals.texels.dtype == np.uint8 else "half",
        "alphas": residuals.alphas.tolist(),
        "directions": residuals.directions.tolist(),
        "sizes": residuals.sizes.tolist(),
    }
    try:
        with zipfile.ZipFile(path, "w", zipfile.ZIP_STORED) as archive:
            _add(archive, "residuals.json", json.dumps(header).encode(), zipfile.ZIP_DEFLATED)
            if atlas is not None:
                _add(archive, "residuals.avif", atlas)
            for index in range(len(residuals.sizes) if atlas is None else 0):
                texels, valid = image_of(residuals, index)
                if texels.dtype == np.uint8:
                    _add(archive, f"{index:03d}.webp", _webp(texels, valid, quality))
                else:
                    _add(archive, f"{index:03d}.npy", _npy(texels, valid), zipfile.ZIP_DEFLATED)
    except OSError as error:
        raise ResourceError(f"{path}: cannot write: {error.strerror or error}") from error
    return path


class SpiralFiles(SampleFiles):
    """The kind "spiral" on disk: one archive per texture."""

    def write_on(
        self, component: SpiralResiduals, layers: LayeredDepthImage, folder: Path, quality: int, speed: int
    ) -> dict[str, str]:
        """Write `residuals.zip` compactly."""
        return {"file": write_residuals(component, folder, quality, True, speed).name}

    def read_on(self, entry: Component, root: Path, shared: object, layers: LayeredDepthImage) -> SpiralResiduals:
        """Read `residuals.zip`."""
        return self.read(entry, root, shared)

    def write(self, component: SpiralResiduals, folder: Path, quality: int) -> dict[str, str]:
        """Write `residuals.zip`."""
        return {"file": write_residuals(component, folder, quality).name}

    def read(self, entry: Component, root: Path, shared: object) -> SpiralResiduals:
        """Read `residuals.zip`."""
        if entry.file is None:
            raise FormatError(f"{root}: a component of kind 'spiral' names no file; copy the asset again")
        return read_residuals(root / entry.file)


def image_of(residuals: SpiralResiduals, index: int) -> tuple[Array, Array]:
    """Texels (H, W, 3) and validity (H, W) of one direction."""
    height, width = (int(size) for size in residuals.sizes[index])
    own = slice(residuals.starts[index], residuals.starts[index + 1])
    return residuals.texels[own].reshape(height, width, 3), residuals.valid[own].reshape(height, width)


def _add(archive: zipfile.ZipFile, name: str, data: bytes, kind: int = zipfile.ZIP_STORED) -> None:
    archive.writestr(zipfile.ZipInfo(name, _DATE), data, kind)


def _webp(texels: Array, valid: Array, quality: int) -> bytes:
    import cv2

    picture = np.dstack([continue_smoothly(texels, valid)[:, :, ::-1], valid.astype(np.uint8) * 255])
    done, data = cv2.imencode(".webp", picture, [cv2.IMWRITE_WEBP_QUALITY, 101 if quality == 100 else quality])
    if not done:
        raise ResourceError("OpenCV cannot write WebP pictures; reinstall opencv-contrib-python-headless")
    return bytes(data)


def _npy(texels: Array, valid: Array) -> bytes:
    buffer = io.BytesIO()
    np.save(buffer, np.dstack([texels, valid]).astype(np.float16))
    return buffer.getvalue()


def continue_smoothly(texels: Array, valid: Array) -> Array:
    """Fill texels (H, W, 3) uint8 that are not valid by averages of coarser and coarser blocks of valid ones."""
    import cv2

    if valid.all() or not valid.any():
        return texels
    weight = valid.astype(np.float32)
    levels = [(texels * weight[:, :, None], weight)]
    while max(levels[-1][1].shape) > 1:
        levels.append((_halved(levels[-1][0]), _halved(levels[-1][1])))
    filled = levels[-1][0] / np.maximum(levels[-1][1], 1e-6)[:, :, None]
    for total, share in levels[-2::-1]:
        wide = cv2.resize(filled, share.shape[::-1], interpolation=cv2.INTER_LINEAR).reshape(*share.shape, 3)
        known = (share > 0)[:, :, None]
        filled = np.where(known, total / np.maximum(share, 1e-6)[:, :, None], wide)
    rounded = np.clip(np.round(filled), 0, 255).astype(np.uint8)
    return np.where(valid[:, :, None], texels, rounded)


def _halved(values: Array) -> Array:
    height, width = values.shape[:2]
    rest = [(0, height % 2), (0, width % 2)] + [(0, 0)] * (values.ndim - 2)
    even = np.pad(values, rest)
    return even[0::2, 0::2] + even[1::2, 0::2] + even[0::2, 1::2] + even[1::2, 1::2]


def read_residuals(path: Path) -> SpiralResiduals:
    """Read `residuals.zip`.

    Raises
    ------
    MissingFileError
        There is no such file.
    FormatError
        It is damaged, or of another schema version.
    """
    try:
        with told(path, "copy the asset again"), zipfile.ZipFile(path) as archive:
            header = _header(archive)
            if header["encoding"] == "avif":
                return _assemble(header, *_unpacked(archive, header))
            images = [_decode(archive, index, header) for index in range(len(header["sizes"]))]
            flat = np.concatenate([image.reshape(-1, 4) for image in images])
            return _assemble(header, np.ascontiguousarray(flat[:, :3]), flat[:, 3] > 0)
    except MissingFileError as error:
        raise MissingFileError(f"{path}: no such file; it should hold a texture's residuals") from error


def _header(archive: zipfile.ZipFile) -> dict[str, Any]:
    """Return what the archive says of itself; sizes are whole numbers, and not too many."""
    header: dict[str, Any] = json.loads(_member(archive, "residuals.json", MOST_HEADER))
    if header["schema"] != SCHEMA:
        raise ValueError(f"residuals of schema {header['schema']}, this version reads {SCHEMA}")
    sizes = header["sizes"]
    if not all(len(size) == 2 and all(type(edge) is int and edge > 0 for edge in size) for size in sizes):
        raise ValueError("a size is not two whole numbers above 0")
    texels = sum(height * width for height, width in sizes)
    if texels > MOST_TEXELS:
        raise ValueError(f"{texels} texels are claimed; at most {MOST_TEXELS} are read")
    return header


def _member(archive: zipfile.ZipFile, name: str, most: int) -> bytes:
    """Return a part of the archive, which unpacks to `most` bytes or fewer."""
    if archive.getinfo(name).file_size > most:
        raise ValueError(f"{name} unpacks to more than {most} bytes")
    return archive.read(name)


def _unpacked(archive: zipfile.ZipFile, header: dict[str, Any]) -> tuple[Array, Array]:
    """Return texels (T, 3) uint8 and valid (T,) of the one picture of all directions."""
    sizes = header["sizes"]
    if any(edge > LONGEST for size in sizes for edge in size):
        raise ValueError(f"an edge is longer than the {LONGEST} texels of one picture")
    try:
        texels = unpack_images(archive.read("residuals.avif"), np.array(sizes, np.int32).reshape(-1, 2))
    except FormatError as error:
        raise ValueError(str(error)) from error
    return texels, np.ones(len(texels), bool)


def _decode(archive: zipfile.ZipFile, index: int, header: dict[str, Any]) -> Array:
    import cv2

    height, width = header["sizes"][index]
    if header["encoding"] == "half":
        data = _member(archive, f"{index:03d}.npy", 8 * height * width + _NPY_HEADER)
        image = read_npy(io.BytesIO(data), len(data)).astype(np.float32)
    elif header["encoding"] != "8bit":
        raise ValueError(f"encoding {header['encoding']!r}, expected 8bit, avif or half")
    else:
        picture = _member(archive, f"{index:03d}.webp", 16 * height * width + (1 << 16))
        found = cv2.imdecode(np.frombuffer(picture, np.uint8), cv2.IMREAD_UNCHANGED)
        if found is None or found.ndim != 3:
            raise ValueError(f"picture {index} is damaged")
        image = found
        if image.shape[2] == 3:  # WebP drops an alpha that is full everywhere
            image = np.dstack([image, np.full(image.shape[:2], 255, np.uint8)])
        image = image[:, :, [2, 1, 0, 3]]
    if image.shape != (height, width, 4):
        raise ValueError(f"picture {index} is {image.shape}, the header says {height} x {width}")
    return image


def _assemble(header: dict[str, Any], texels: Array, valid: Array) -> SpiralResiduals:
    sizes = np.array(header["sizes"], np.int32)
    frame = frame_from_json(header["rectangle"])
    if not isinstance(frame, ParallelFrame):
        raise ValueError("the rectangle of residuals must be parallel")
    alphas, directions = np.array(header["alphas"], float), np.array(header["directions"], float)
    if type(header["closed"]) is not bool or not isinstance(header["k"], int | float):
        raise ValueError(f"closed is {header['closed']!r} and k {header['k']!r}, expected true or false, and a number")
    return SpiralResiduals(
        frame,
        header["k"],
        alphas,
        directions,
        sizes,
        np.concatenate([[0], np.cumsum(sizes.astype(np.int64).prod(axis=1))]),
        texels,
        valid,
        header["zero"],
        header["closed"],
    )
