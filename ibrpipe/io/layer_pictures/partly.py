"""Layers coded in one respect, the rest as it was: what that respect alone costs and loses."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from ibrpipe.io.layer_pictures import values
from ibrpipe.io.layer_pictures.coding import Coding
from ibrpipe.io.layer_pictures.normal_parts import pack_normals, unpack_normals
from ibrpipe.io.layer_pictures.planes import planes_of
from ibrpipe.types import LayeredDepthImage


def coded_partly(layers: LayeredDepthImage, coding: Coding) -> tuple[LayeredDepthImage, int]:
    """Return layers as a reader would find those of their values that `coding` names, and the bytes of these."""
    parts: values.Parts = {}
    planes = planes_of(layers.offsets)
    found: dict[str, Any] = {}
    if coding.color_quality is not None or coding.codewords is not None:
        found["color"] = values.unpack_color(values.pack_color(layers.color, planes, coding, parts), planes, parts)
    if coding.depth_step is not None:
        said = values.pack_depth(layers, planes, coding.depth_step, parts)
        found["depth"] = np.ascontiguousarray(values.unpack_exact("depth", said, 1, planes, parts)[:, 0])
    if coding.normal_quality is not None or coding.normal_bits is not None:
        said = pack_normals(layers.normal, layers.depth, layers.frame, planes, coding, parts)
        found["normal"] = unpack_normals(said, layers.depth, layers.frame, planes, parts)
    return replace(layers, **found), sum(map(len, parts.values()))
