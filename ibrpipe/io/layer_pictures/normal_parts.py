"""Normals of layers: exactly, as octahedral coordinates, had from depth where right, or as differences from that."""

from __future__ import annotations

import zlib
from collections.abc import Mapping, Sequence

import numpy as np

from ibrpipe.errors import FormatError
from ibrpipe.io.layer_pictures.atlas import Atlas
from ibrpipe.io.layer_pictures.avif import QUICK, decode_avif, encode_avif
from ibrpipe.io.layer_pictures.bounded import inflate
from ibrpipe.io.layer_pictures.coding import Coding
from ibrpipe.io.layer_pictures.derived_normals import derived_normals
from ibrpipe.io.layer_pictures.normal_pictures import differences, normals_of
from ibrpipe.io.layer_pictures.normals import from_octahedral, octahedral
from ibrpipe.io.layer_pictures.numbers import pack_numbers, unpack_numbers
from ibrpipe.io.layer_pictures.planes import Plane
from ibrpipe.io.layer_pictures.values import Parts, Said, pack_exact, unpack_exact
from ibrpipe.types import Array, Camera, ParallelFrame


def pack_normals(
    normal: Array,
    depth: Array,
    frame: ParallelFrame | Camera,
    planes: Sequence[Plane],
    coding: Coding,
    parts: Parts,
    speed: int = QUICK,
) -> Said:
    """Pack normals (S, 3); `depth` (S,) is what a reader will find."""
    atlas, bits = Atlas(planes, 2), coding.normal_bits
    quality = coding.normal_quality if atlas.fits else None
    unknown = ~(np.nan_to_num(normal) != 0).any(axis=1)
    if unknown.any() and (bits is not None or quality is not None):
        parts["normal_unknown"] = pack_numbers(unknown.astype(np.int64), planes)
    if quality is not None:
        codes = differences(normal, derived_normals(frame, depth, planes), frame)
        parts["normal.avif"] = encode_avif(atlas.spread(codes), quality, speed)
        return {"coding": "differences", "quality": quality, "unknown": bool(unknown.any())}
    if bits is None:
        return pack_exact("normal", normal, planes, parts)
    square = octahedral(normal, bits)
    said = {"bits": bits, "unknown": bool(unknown.any())}
    if coding.normal_tolerance is None:
        for i in range(2):
            parts[f"normal_{i}"] = pack_numbers(square[:, i], planes)
        return {"coding": "octahedral", **said}
    right = _agree(derived_normals(frame, depth, planes), normal, coding.normal_tolerance) | unknown
    parts["normal_given"] = zlib.compress(np.packbits(~right).tobytes(), 9)
    parts["normal_2"] = zlib.compress(square[~right].astype("<i4").T.tobytes(), 9)
    return {"coding": "derived", **said}


def unpack_normals(
    said: Said, depth: Array, frame: ParallelFrame | Camera, planes: Sequence[Plane], parts: Mapping[str, bytes]
) -> Array:
    """Return normals (S, 3) float32; NaN where unknown."""
    if said["coding"] == "exact":
        return unpack_exact("normal", said, 3, planes, parts)
    if said["coding"] == "differences":
        atlas = Atlas(planes, 2)
        codes = atlas.gather(decode_avif(parts["normal.avif"], atlas.shape))
        return _known(normals_of(codes, derived_normals(frame, depth, planes), frame), said, planes, parts)
    bits, count = said["bits"], len(depth)
    if said["coding"] not in ("octahedral", "derived") or type(bits) is not int or not 3 <= bits <= 16:
        raise FormatError(f"normals are coded as {said['coding']!r} of {bits} bits, which is unknown")
    if said["coding"] == "octahedral":
        square = np.stack([unpack_numbers(parts[f"normal_{i}"], planes) for i in range(2)], axis=1)
        found = from_octahedral(square, bits)
    else:
        given = np.unpackbits(np.frombuffer(inflate(parts["normal_given"], -(-count // 8)), np.uint8), count=count) > 0
        rest = np.frombuffer(inflate(parts["normal_2"], 8 * int(given.sum())), "<i4").reshape(2, -1).T
        found = derived_normals(frame, depth, planes).astype(np.float32)
        found[given] = from_octahedral(rest, bits)
    return _known(found, said, planes, parts)


def _known(normal: Array, said: Said, planes: Sequence[Plane], parts: Mapping[str, bytes]) -> Array:
    """Return normals (S, 3); NaN where they are unknown."""
    if said["unknown"]:
        normal[unpack_numbers(parts["normal_unknown"], planes) != 0] = np.nan
    return normal


def _agree(derived: Array, normal: Array, degrees: float) -> Array:
    """Return which normals (S,) the derived ones are within so many degrees of."""
    known = np.nan_to_num(normal.astype(np.float64))
    along = (derived * known).sum(axis=1)
    across = np.linalg.norm(np.cross(derived, known), axis=1)
    return np.arctan2(across, along) <= np.radians(degrees)
