"""The surface of layered images as pages hold it: samples, and the patches that the renderers make of them."""

from __future__ import annotations

from typing import Any

import numpy as np

from ibrpipe.core.color import srgb_encode, to_bytes
from ibrpipe.errors import FormatError
from ibrpipe.export.page.packing import Packer, foretell, neighbours
from ibrpipe.renderers.fields import PatchField, Pose, build_field, texel_size
from ibrpipe.types import Array, LayeredDepthImage

#: codes of a depth at most, and of a coordinate of a normal
DEPTHS, NORMALS = 1 << 16, 1 << 12


def pack_surface(layers: LayeredDepthImage, packer: Packer) -> dict[str, Any]:
    """Pack samples and patches of a layered image; return what the page's scripts need to find them.

    Depths are exact where a texture has at most 65536 different ones, else rounded to as many levels.

    Raises
    ------
    FormatError
        A texel has more samples than a byte counts.
    """
    field = build_field(layers)
    assert isinstance(field, PatchField)
    rows, columns = layers.shape
    counts = np.diff(layers.offsets, axis=1)
    if counts.max(initial=0) > 254:
        raise FormatError(f"a texel holds {counts.max()} samples; a page shows at most 254: plan fewer layers")
    around = neighbours(layers.offsets)
    depth = layers.depth if not field.pose.perspective else (-1.0 / layers.depth.astype(np.float64)).astype(np.float32)
    levels, codes = depth_codes(depth)
    u, v = octahedral_codes(layers.normal)
    color = to_bytes(srgb_encode(layers.color))
    filled = to_bytes(field.color[:, 3])
    filled = np.where(field.color[:, 3] > 0, np.maximum(filled, 1), 0).astype(np.uint8)

    def foretold(values: Array) -> dict[str, Any]:
        return packer.add(values, foretell(values, around))

    return {
        "rows": rows,
        "columns": columns,
        "texel": texel_size(field),
        "world": world_from_field(field.pose.turned() if field.pose.away else field.pose).ravel().tolist(),
        "counts": packer.add(counts.astype(np.uint8)),
        "levels": packer.add(levels),
        "depth": foretold(codes),
        "color": [foretold(channel) for channel in color.T],
        "normal": [foretold(u), foretold(v)],
        "filled": None if (filled == 255).all() else packer.add(filled),
        **_pack_patches(field, layers, packer),
    }


def depth_codes(depth: Array) -> tuple[Array, Array]:
    """Levels (L,) float32, and which of them each depth (S,) is, uint16."""
    levels, codes = np.unique(depth, return_inverse=True)
    if len(levels) > DEPTHS:
        levels = np.linspace(depth.min(), depth.max(), DEPTHS).astype(np.float32)
        codes = np.round((depth - levels[0]) * ((DEPTHS - 1) / (levels[-1] - levels[0])))
    return levels.astype(np.float32), np.clip(codes, 0, DEPTHS - 1).astype(np.uint16)


def octahedral_codes(normal: Array) -> tuple[Array, Array]:
    """Octahedral coordinates (cigolle2014) of unit vectors (S, 3) in NORMALS steps, uint16; top code = unknown."""
    known = np.isfinite(normal.sum(axis=1))
    n = np.where(known[:, None], normal, (0.0, 0.0, 1.0)).astype(np.float64)
    x, y, z = (n / np.maximum(np.abs(n).sum(axis=1, keepdims=True), 1e-12)).T
    u = np.where(z < 0, np.copysign(1 - abs(y), x), x)
    v = np.where(z < 0, np.copysign(1 - abs(x), y), y)
    codes = np.round((np.stack([u, v]) + 1) * (0.5 * (NORMALS - 2)))
    found = np.where(known, codes, NORMALS - 1).astype(np.uint16)
    return found[0], found[1]


def world_from_field(pose: Pose) -> Array:
    """(4, 4) float64: homogeneous world coordinates of weight above 0 from (u, v, field depth, 1)."""
    out = np.zeros((4, 4))
    if pose.perspective:  # with weight 1/z: X / z = M (u, v, 1) + origin / z, field depth is -1/z
        inverse = np.linalg.inv(pose.linear[[0, 1, 3]])
        out[:3, :2], out[:3, 3] = inverse[:, :2], inverse[:, 2]
        out[:3, 2], out[3, 2] = -pose.origin, -1.0
        return out
    inverse = np.linalg.inv(pose.linear[:3])
    out[:3, :3], out[:3, 3], out[3, 3] = inverse, pose.origin - inverse @ pose.shift[:3], 1.0
    return out


def _pack_patches(field: PatchField, layers: LayeredDepthImage, packer: Packer) -> dict[str, Any]:
    """Pack patches by cell: of each corner the rank of its sample in its texel plus 1, or 0 and a depth of its own."""
    rows, columns = layers.shape
    column, row = field.cells.T.astype(np.int64)
    counts = np.bincount(row * (columns + 1) + column, minlength=(rows + 1) * (columns + 1))
    ranks = []
    for corner in range(4):
        sample = field.samples[:, corner]
        y, x = row - 1 + (corner >> 1), column - 1 + (corner & 1)
        there = sample >= 0
        first = layers.offsets[np.where(there, y, 0), np.where(there, x, 0)]
        ranks.append(np.where(there, sample - first + 1, 0).astype(np.uint8))
    return {
        "patches": len(field.corners),
        "cells": packer.add(counts.astype(np.uint8)),
        "ranks": [packer.add(rank) for rank in ranks],
        "missing": packer.add(field.corners[field.samples < 0]),
    }
