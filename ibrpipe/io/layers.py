"""Layered depth images as deep OpenEXR: R G B A, Z, N.x N.y N.z and how many photos gave each sample its colour.

Any deep-aware compositor opens the file. Z is the depth along the frame's projection (``frame.f`` of a parallel frame,
camera z of a perspective one); A is the share of its texel that a sample fills, 0 for samples that no photo has seen.
The frame stands in the header.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from ibrpipe.errors import FormatError, MissingFileError, ResourceError
from ibrpipe.io.untrusted.boundary import reader
from ibrpipe.picture_files import FIXED_DATE, one_line
from ibrpipe.types import Array, Camera, LayeredDepthImage, ParallelFrame
from ibrpipe.types.layers import offsets_of

CHANNELS = ("R", "G", "B", "A", "Z", "N.x", "N.y", "N.z", "observers")
FRAME = "ibrpipe:frame"


def frame_as_json(frame: ParallelFrame | Camera) -> dict[str, object]:
    """Plain values of a frame."""
    if isinstance(frame, Camera):
        return {
            "projection": "perspective",
            "K": frame.K.tolist(),
            "cam_from_world": frame.cam_from_world.tolist(),
            "width": frame.width,
            "height": frame.height,
        }
    return {"projection": "parallel", **{name: getattr(frame, name).tolist() for name in ("origin", "a", "b", "f")}}


def frame_from_json(data: dict[str, object]) -> ParallelFrame | Camera:
    """Read what `frame_as_json` wrote."""
    if data["projection"] == "perspective":
        return Camera(data["K"], data["cam_from_world"], data["width"], data["height"])  # type: ignore[arg-type]
    return ParallelFrame(*(np.array(data[name]) for name in ("origin", "a", "b", "f")))


def write_layers(layers: LayeredDepthImage, path: Path) -> None:
    """Write a layered depth image; colours, normals and counts as half floats, depth as float32.

    Raises
    ------
    ResourceError
        The file cannot be written.
    """
    import OpenImageIO as oiio

    height, width = layers.shape
    spec = oiio.ImageSpec(width, height, len(CHANNELS), oiio.FLOAT)
    spec.channelnames = CHANNELS
    spec.channelformats = tuple(oiio.FLOAT if name == "Z" else oiio.HALF for name in CHANNELS)
    spec.deep = True
    spec.attribute("compression", "zips")
    spec.attribute("DateTime", FIXED_DATE)
    spec.attribute("oiio:ColorSpace", "lin_rec709_scene")
    spec.attribute(FRAME, json.dumps(frame_as_json(layers.frame)))
    deep = oiio.DeepData()
    deep.init(height * width, len(CHANNELS), spec.channelformats, spec.channelnames)
    _fill(deep, layers)
    output = oiio.ImageOutput.create(str(path))
    if output is None or not (output.open(str(path), spec) and output.write_deep_image(deep) and output.close()):
        raise ResourceError(f"{path}: cannot write: {one_line(output.geterror() if output else oiio.geterror())}")


def _fill(deep: object, layers: LayeredDepthImage) -> None:
    counts = np.diff(layers.offsets, axis=1).ravel().tolist()
    observers = layers.observers if layers.observers is not None else np.ones(len(layers.depth), np.int32)
    filled = np.where(observers > 0, 1.0 if layers.coverage is None else layers.coverage, 0.0)
    table = np.column_stack([layers.color, filled, layers.depth, np.nan_to_num(layers.normal), observers])
    rows = iter(table.astype(float).tolist())
    set_samples, set_value = deep.set_samples, deep.set_deep_value  # type: ignore[attr-defined]
    for pixel, count in enumerate(counts):  # all before the first value: later changes would move what is stored
        if count:
            set_samples(pixel, count)
    for pixel, count in enumerate(counts):
        if count:
            for sample in range(count):
                for channel, value in enumerate(next(rows)):
                    set_value(pixel, channel, sample, value)


@reader("copy the asset again")
def read_layers(path: Path) -> LayeredDepthImage:
    """Read a layered depth image.

    Raises
    ------
    MissingFileError
        There is no such file.
    FormatError
        It is not a deep OpenEXR written by `write_layers`.
    """
    if not path.is_file():
        raise MissingFileError(f"{path}: no such file; it should hold a texture's layers (deep OpenEXR)")
    return _read(path)


def _read(path: Path) -> LayeredDepthImage:
    import OpenImageIO as oiio

    image = oiio.ImageInput.open(str(path))
    if image is None:
        reason = one_line(oiio.geterror())
        raise FormatError(f"{path}: cannot be read as an image ({reason}); copy the asset again")
    spec = image.spec()
    header = spec.getattribute(FRAME)
    missing = [name for name in CHANNELS if name not in spec.channelnames]
    if not spec.deep or header is None or missing:
        raise FormatError(
            f"{path}: expected a deep OpenEXR with channels {' '.join(CHANNELS)} and a header {FRAME}; "
            f"missing: {', '.join(missing) or ('header' if spec.deep else 'deep pixels')}"
        )
    deep = image.read_native_deep_image()
    if deep is None:
        raise FormatError(f"{path}: damaged ({one_line(image.geterror())}); copy the asset again")
    counts, table = _table(deep, [spec.channelnames.index(name) for name in CHANNELS])
    offsets = offsets_of(counts.reshape(spec.height, spec.width))
    filled = np.where(table[:, 8] > 0, table[:, 3], np.float32(1.0))
    return LayeredDepthImage(
        frame_from_json(json.loads(header)),
        offsets,
        table[:, 4],
        table[:, :3],
        table[:, 5:8],
        table[:, 8].astype(np.int32),
        None if (filled == 1).all() else filled,
    )


def _table(deep: object, channels: list[int]) -> tuple[Array, Array]:
    value, samples, pixels = deep.deep_value, deep.samples, deep.pixels  # type: ignore[attr-defined]
    counts = np.array([samples(pixel) for pixel in range(pixels)], np.int64)
    rows = [
        [value(int(pixel), channel, sample) for channel in channels]
        for pixel in np.flatnonzero(counts)
        for sample in range(int(counts[pixel]))
    ]
    return counts, np.array(rows, np.float32).reshape(-1, len(channels))
