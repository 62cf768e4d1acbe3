"""`layers.zip`: the compact form of one layered depth image, which any zip tool opens.

`layers.json` says sizes and codings; `occupancy` which texels have how many samples; the colours are JPEG XL pictures,
one per layer; depths, normals, observers and, where texels are filled in part, coverage are whole numbers, foretold
along the picture. Every number is checked before it is used: a damaged or hostile file ends in one line.
"""

from __future__ import annotations

import json
import struct
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ibrpipe.errors import FormatError, IbrError, MissingFileError, ResourceError
from ibrpipe.io.layer_pictures import values
from ibrpipe.io.layer_pictures.avif import QUICK
from ibrpipe.io.layer_pictures.coding import Coding
from ibrpipe.io.layer_pictures.normal_parts import pack_normals, unpack_normals
from ibrpipe.io.layer_pictures.planes import pack_occupancy, planes_of, unpack_occupancy
from ibrpipe.io.layers import frame_as_json, frame_from_json
from ibrpipe.io.untrusted.boundary import reader
from ibrpipe.picture_files import one_line
from ibrpipe.types import Camera, LayeredDepthImage

NAME = "layers.zip"
SCHEMA = 1
#: no texture has more texels (all layers together) or layers than these, no header more bytes
MOST_TEXELS, MOST_LAYERS, MOST_HEADER = 2**28, 1024, 2**20
_DATE = (1980, 1, 1, 0, 0, 0)
#: what reading a damaged archive can end in
_DAMAGE = (
    *(zipfile.BadZipFile, zlib.error, struct.error, EOFError, OSError, NotImplementedError),
    *(LookupError, RuntimeError, TypeError, ValueError, ArithmeticError, MemoryError, RecursionError),
)


def write_layer_pictures(layers: LayeredDepthImage, path: Path, coding: Coding, speed: int = QUICK) -> None:
    """Write a layered depth image compactly; without losses every bit comes back.

    Raises
    ------
    ResourceError
        The file cannot be written, or the texture is too large for this form.
    """
    height, width = layers.shape
    planes = planes_of(layers.offsets)
    if height * width * max(len(planes), 1) > MOST_TEXELS or len(planes) > MOST_LAYERS:
        raise ResourceError(
            f"{path}: {width} x {height} texels in {len(planes)} layers are more than the compact form takes "
            f"({MOST_TEXELS} texels, {MOST_LAYERS} layers); plan smaller textures"
        )
    parts: values.Parts = {"occupancy": pack_occupancy(layers.offsets, planes)}
    said = values.pack_depth(layers, planes, coding.depth_step, parts)
    depth = values.unpack_exact("depth", said, 1, planes, parts)[:, 0]  # as it will be read
    header = {
        "schema": SCHEMA,
        "frame": frame_as_json(layers.frame),
        "height": height,
        "width": width,
        "samples": [len(plane.samples) for plane in planes],
        "color": values.pack_color(layers.color, planes, coding, parts, speed),
        "depth": said,
        "normal": pack_normals(layers.normal, depth, layers.frame, planes, coding, parts, speed),
        "observers": values.pack_observers(layers.observers, planes, coding.lossless, parts),
    }
    if layers.coverage is not None:
        header["coverage"] = values.pack_exact("coverage", layers.coverage, planes, parts)
    try:
        with zipfile.ZipFile(path, "w", zipfile.ZIP_STORED) as archive:
            for name, data in ({"layers.json": json.dumps(header).encode()} | parts).items():
                archive.writestr(zipfile.ZipInfo(name, _DATE), data)
    except OSError as error:
        raise ResourceError(f"{path}: cannot write: {error.strerror or error}") from error


@reader("copy the asset again")
def read_layer_pictures(path: Path) -> LayeredDepthImage:
    """Read what `write_layer_pictures` wrote.

    Raises
    ------
    MissingFileError
        There is no such file.
    FormatError
        It is damaged, or of another schema version.
    """
    if not path.is_file():
        raise MissingFileError(f"{path}: no such file; it should hold a texture's layers")
    try:
        return _layers(*_opened(path))
    except (*_DAMAGE, IbrError) as error:
        raise FormatError(f"{path}: damaged ({one_line(str(error))}); copy the asset again") from error


def _opened(path: Path) -> tuple[dict[str, Any], dict[str, bytes]]:
    """Return header and parts; none can be larger than the file, because nothing is packed twice."""
    with zipfile.ZipFile(path) as archive:
        files = archive.infolist()
        whole = path.stat().st_size
        if any(file.compress_type != zipfile.ZIP_STORED for file in files):
            raise FormatError("a part is packed once more")
        if sum(file.file_size for file in files) > whole or len(files) > MOST_LAYERS + 32:
            raise FormatError("it claims to hold more than it does")
        if archive.getinfo("layers.json").file_size > MOST_HEADER:
            raise FormatError("its header is too long")
        header = json.loads(archive.read("layers.json"))
        parts = {file.filename: archive.read(file) for file in files}
    if header["schema"] != SCHEMA:
        raise FormatError(f"layers of schema {header['schema']}, this version reads {SCHEMA}")
    return header, parts


def _layers(header: Mapping[str, Any], parts: Mapping[str, bytes]) -> LayeredDepthImage:
    height, width, samples = header["height"], header["width"], header["samples"]
    if len(samples) > MOST_LAYERS or not all(type(size) is int and size > 0 for size in (height, width, *samples)):
        raise FormatError("its sizes cannot be")
    if height * width * max(len(samples), 1) > MOST_TEXELS:
        raise FormatError(f"{width} x {height} texels in {len(samples)} layers are too many")
    offsets = unpack_occupancy(parts["occupancy"], (height, width), samples)
    planes = planes_of(offsets)
    frame = frame_from_json(header["frame"])
    filled = header.get("coverage")
    depth = values.unpack_exact("depth", header["depth"], 1, planes, parts)[:, 0]
    if isinstance(frame, Camera) and (depth <= 0).any():
        raise FormatError("a sample lies behind the camera")
    return LayeredDepthImage(
        frame,
        offsets,
        np.ascontiguousarray(depth),
        values.unpack_color(header["color"], planes, parts),
        unpack_normals(header["normal"], depth, frame, planes, parts),
        values.unpack_observers(header["observers"], planes, parts),
        None
        if filled is None
        else np.ascontiguousarray(values.unpack_exact("coverage", filled, 1, planes, parts)[:, 0]),
    )
