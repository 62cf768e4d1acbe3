"""Colours, depths, normals and observers of layers, each coded as `Coding` asks and told of in the header."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ibrpipe.core.color import decode_table, srgb_encode
from ibrpipe.errors import FormatError
from ibrpipe.io.layer_pictures.atlas import Atlas
from ibrpipe.io.layer_pictures.avif import QUICK, decode_avif, encode_avif
from ibrpipe.io.layer_pictures.codebook import pack_blocks, unpack_blocks
from ibrpipe.io.layer_pictures.coding import Coding
from ibrpipe.io.layer_pictures.exact import common_step, numbers_of, values_of
from ibrpipe.io.layer_pictures.numbers import pack_numbers, unpack_numbers
from ibrpipe.io.layer_pictures.pictures import decode_picture, encode_picture
from ibrpipe.io.layer_pictures.planes import Plane
from ibrpipe.types import Array, Camera, LayeredDepthImage
from ibrpipe.types.layers import pitch_of

#: name of a part in the archive to its bytes
Parts = dict[str, bytes]
#: what the header says of a kind of value
Said = dict[str, Any]

_CODES = 256
#: best quality at which AVIF, whose luma and chroma are rounded to 8 bits, needs fewer bytes than JPEG XL
BEST_AVIF = 96
_LARGEST = float(np.finfo(np.float32).max)


def pack_exact(name: str, values: Array, planes: Sequence[Plane], parts: Parts) -> Said:
    """Pack float32 values (S,) or (S, C) so that every bit comes back."""
    columns = [values] if values.ndim == 1 else values.T
    step = common_step(values.ravel())
    for i, column in enumerate(columns):
        parts[f"{name}_{i}"] = pack_numbers(numbers_of(column, step), planes)
    return {"coding": "exact", "step": step}


def unpack_exact(name: str, said: Said, columns: int, planes: Sequence[Plane], parts: Mapping[str, bytes]) -> Array:
    """Return float32 values (S, columns)."""
    step = None if said["step"] is None else _positive(said["step"])
    found = [values_of(unpack_numbers(parts[f"{name}_{i}"], planes), step) for i in range(columns)]
    return np.stack(found, axis=1)


def pack_color(color: Array, planes: Sequence[Plane], coding: Coding, parts: Parts, speed: int = QUICK) -> Said:
    """Pack colours (S, 3): as pictures of 8-bit sRGB codes where that is asked for or loses nothing."""
    quality = coding.color_quality
    if quality is None and coding.codewords is None:
        held, codes = _as_codes(color)
        if held is None:
            return pack_exact("color", color, planes, parts)
        top = 1.0
    else:
        held, top = "float", float(max(1.0, color.max(initial=0.0)))
        codes = np.round(255.0 * srgb_encode(color / np.float32(top))).astype(np.uint8)
    atlas = Atlas(planes)
    if quality is not None and quality <= BEST_AVIF and coding.codewords is None and atlas.fits:
        parts["color.avif"] = encode_avif(atlas.spread(codes), quality, speed, coding.half_chroma is True)
        return {"coding": "avif", "quality": quality, "top": top, "held": held}
    pictures = []
    for plane in planes:
        picture = np.zeros((*plane.there.shape, 3), np.uint8)
        picture[plane.there] = codes[plane.samples]
        pictures.append(continued(picture, plane.there))
    if coding.codewords is not None:
        theres = [plane.there for plane in planes]
        parts["color_words"], parts["color_blocks"] = pack_blocks(pictures, theres, coding.codewords)
        return {"coding": "blocks", "top": top, "held": held}
    for layer, picture in enumerate(pictures):
        parts[f"color_{layer}.jxl"] = encode_picture(picture, quality)
    return {"coding": "jxl", "quality": quality, "top": top, "held": held}


def unpack_color(said: Said, planes: Sequence[Plane], parts: Mapping[str, bytes]) -> Array:
    """Return colours (S, 3) float32."""
    if said["coding"] == "exact":
        return unpack_exact("color", said, 3, planes, parts)
    if said["coding"] not in ("avif", "jxl", "blocks") or said["held"] not in ("float", "half"):
        raise FormatError(f"colours are coded as {said['coding']!r}, {said['held']!r}, which is unknown")
    if said["coding"] == "avif":
        atlas = Atlas(planes)
        codes = atlas.gather(decode_avif(parts["color.avif"], (*atlas.shape, 3)))
    else:
        codes = np.zeros((sum(len(plane.samples) for plane in planes), 3), np.uint8)
        for plane, picture in zip(planes, _pictures(said["coding"], planes, parts), strict=True):
            codes[plane.samples] = picture[plane.there]
    found: Array = _light(said["held"])[codes] * np.float32(_positive(said["top"]))
    return found


def _pictures(coding: str, planes: Sequence[Plane], parts: Mapping[str, bytes]) -> list[Array]:
    if coding == "blocks":
        return unpack_blocks(parts["color_words"], parts["color_blocks"], [plane.there for plane in planes])
    shapes = [(plane.there.shape[0], plane.there.shape[1]) for plane in planes]
    return [decode_picture(parts[f"color_{layer}.jxl"], shape) for layer, shape in enumerate(shapes)]


def pack_depth(layers: LayeredDepthImage, planes: Sequence[Plane], share: float | None, parts: Parts) -> Said:
    """Pack depths (S,), rounded to a share of a texel's pitch or exactly."""
    exact = common_step(layers.depth)
    wanted = None if share is None else share * pitch_of(layers)
    if wanted is None or (exact is not None and exact >= wanted):
        return pack_exact("depth", layers.depth, planes, parts)
    step = max(wanted, float(np.abs(layers.depth).max(initial=0.0)) * 2.0**-31)
    numbers = np.round(layers.depth.astype(np.float64) / step).astype(np.int64)
    if isinstance(layers.frame, Camera):
        numbers = np.maximum(numbers, 1)
    parts["depth_0"] = pack_numbers(numbers, planes)
    return {"coding": "exact", "step": step}


def pack_observers(observers: Array | None, planes: Sequence[Plane], exact: bool, parts: Parts) -> Said:
    """Pack how many photos saw each sample; not exactly = whether any did."""
    if observers is None:
        return {"coding": "none"}
    parts["observers"] = pack_numbers(observers.astype(np.int64) if exact else (observers > 0).astype(np.int64), planes)
    return {"coding": "counts" if exact else "seen"}


def unpack_observers(said: Said, planes: Sequence[Plane], parts: Mapping[str, bytes]) -> Array | None:
    """Return the counts (S,) int32; None = they were not known."""
    if said["coding"] == "none":
        return None
    if said["coding"] not in ("counts", "seen"):
        raise FormatError(f"observers are coded as {said['coding']!r}, which is unknown")
    found = unpack_numbers(parts["observers"], planes)
    if len(found) and (found.min() < 0 or found.max() >= 2**31):
        raise FormatError("a sample has a number of observers that cannot be")
    return found.astype(np.int32)


def continued(picture: Array, there: Array) -> Array:
    """Fill the texels of a picture (h, w, 3) uint8 that are not there smoothly, so that they cost little."""
    from ibrpipe.io.residuals import continue_smoothly

    return continue_smoothly(picture, there)


def _light(held: str) -> Array:
    table = decode_table(_CODES)
    return table.astype(np.float16).astype(np.float32) if held == "half" else table


def _as_codes(color: Array) -> tuple[str | None, Array]:
    """Return the 8-bit codes of colours and how these are held, if that loses nothing."""
    codes = np.round(255.0 * srgb_encode(color)).astype(np.uint8)
    held = (name for name in ("half", "float") if np.array_equal(_light(name)[codes], color))
    return next(held, None), codes


def _positive(value: Any) -> float:
    if not isinstance(value, int | float) or not 0 < value < _LARGEST:
        raise FormatError(f"a step or scale is {value!r}; it must be a positive number")
    return float(value)
