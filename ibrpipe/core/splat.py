"""Forward warp: every reference sample is projected and covers the pixels of its footprint (schaufler1999, eq. 2)."""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from ibrpipe.core.jit import kernel
from ibrpipe.core.ldi.project_heights import improve


@kernel
def splat_samples(flat, stride, pixel, perspective, eye, base, grow, depth, ids):
    # flat (rows * stride,) f32 field depths, NaN = background; pixel (3, 4): (u, v, d, 1) to homogeneous pixels; grow:
    # footprint in texels; depth (C, h, w) f32 and ids (C, h, w) u32: one picture per chunk of samples, lowered in place
    chunks, rows, columns = depth.shape
    for chunk in prange(chunks):
        own_depth, own_ids = depth[chunk], ids[chunk]
        for sample in range(np.int64(chunk), len(flat), chunks):
            d = float(flat[sample])
            if d != d:
                continue
            u, v = float(sample % stride), float(sample // stride)
            w = pixel[2, 0] * u + pixel[2, 1] * v + pixel[2, 2] * d + pixel[2, 3]
            t = -w / d if perspective else w
            if not (t > eye and w > 0.0):
                continue
            x = (pixel[0, 0] * u + pixel[0, 1] * v + pixel[0, 2] * d + pixel[0, 3]) / w
            y = (pixel[1, 0] * u + pixel[1, 1] * v + pixel[1, 2] * d + pixel[1, 3]) / w
            wide = 0.5 * grow * (abs(pixel[0, 0] - x * pixel[2, 0]) + abs(pixel[0, 1] - x * pixel[2, 1])) / w
            high = 0.5 * grow * (abs(pixel[1, 0] - y * pixel[2, 0]) + abs(pixel[1, 1] - y * pixel[2, 1])) / w
            left, right = max(math.ceil(x - wide - 0.5), 0.0), min(math.floor(x + wide - 0.5), columns - 1.0)
            top, bottom = max(math.ceil(y - high - 0.5), 0.0), min(math.floor(y + high - 0.5), rows - 1.0)
            for py in range(int(top), int(bottom) + 1):
                for px in range(int(left), int(right) + 1):
                    improve(own_depth, own_ids, py, px, t, np.uint32(base + sample))
