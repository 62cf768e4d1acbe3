"""Pictures by Embree: packets of 16 rays, hits shaded as the renderer `hierarchical` shades."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numba import get_thread_id, prange

from ibrpipe.bench.forest.embree_instances import embree
from ibrpipe.core.jit import foreign, fused

#: words of a packet: ray and hit (21 rows of 16), then the mask of its valid lanes, on lines of 64 bytes
ROWS, MASK = 32, 30
NG, U, V, PRIMITIVE, GEOMETRY, INSTANCE = 12, 15, 16, 17, 18, 19


@fused
def shade_hit(lane, numbers, words, tables, lights, lighting, out):
    # -> out (4,): linear light and coverage of one lane of a packet
    firsts, turns, own, paints = tables
    geometry, instance = words[GEOMETRY * 16 + lane], words[INSTANCE * 16 + lane]
    if geometry == -1:
        out[0], out[1], out[2], out[3] = 0.0, 0.0, 0.0, 0.0
        return
    first = firsts[instance] if instance >= 0 else own
    nx, ny, nz = numbers[NG * 16 + lane], numbers[(NG + 1) * 16 + lane], numbers[(NG + 2) * 16 + lane]
    x, y, z = nx, ny, nz
    if instance >= 0:
        m = turns[instance]
        x = m[0, 0] * nx + m[0, 1] * ny + m[0, 2] * nz
        y = m[1, 0] * nx + m[1, 1] * ny + m[1, 2] * nz
        z = m[2, 0] * nx + m[2, 1] * ny + m[2, 2] * nz
    length = math.sqrt(x * x + y * y + z * z)
    if x * numbers[4 * 16 + lane] + y * numbers[5 * 16 + lane] + z * numbers[6 * 16 + lane] > 0.0:
        length = -length
    u, v = numbers[U * 16 + lane], numbers[V * 16 + lane]
    color = paints[first + words[PRIMITIVE * 16 + lane]]
    for c in range(3):
        out[c] = lighting[0, c]
    for n in range(len(lights)):
        cosine = max((x * lights[n, 0] + y * lights[n, 1] + z * lights[n, 2]) / length, np.float32(0.0))
        for c in range(3):
            out[c] += lighting[1 + n, c] * cosine
    for c in range(3):
        out[c] *= (np.float32(1.0) - u - v) * color[0, c] + u * color[1, c] + v * color[2, c]
    out[3] = 1.0


def packet_caster() -> Callable[..., Any]:
    """Compile the loop that casts a picture's packets; it is not kept, for it holds addresses of this process."""
    intersect = embree().rtcIntersect16

    @foreign
    def cast(scene, arguments, packets, base, eye, turn, side, tables, lights, lighting, out):
        # side x side samples a pixel (1, 2, 4, 8 or 16), in packets of 4 x 4 -> out (H, W, 4) f32, premultiplied
        block = max(4, side)
        per = block // side
        share = np.float32(1.0 / (side * side))
        for row in prange((out.shape[0] + per - 1) // per):
            thread = get_thread_id()
            numbers = packets[thread]
            words = numbers.view(np.int32)
            here = base + thread * ROWS * 64
            color = np.empty(4, np.float32)
            for column in range((out.shape[1] + per - 1) // per):
                for y in range(row * per, min((row + 1) * per, out.shape[0])):
                    for x in range(column * per, min((column + 1) * per, out.shape[1])):
                        for c in range(4):
                            out[y, x, c] = 0.0
                for part in range((block // 4) ** 2):
                    left, top = column * block + part % (block // 4) * 4, row * block + part // (block // 4) * 4
                    for lane in range(16):
                        px = np.float32(left + (lane & 3) + 0.5) / np.float32(side)
                        py = np.float32(top + (lane >> 2) + 0.5) / np.float32(side)
                        for c in range(3):
                            numbers[c * 16 + lane] = eye[c]
                            numbers[(4 + c) * 16 + lane] = turn[c, 0] * px + turn[c, 1] * py + turn[c, 2]
                        numbers[3 * 16 + lane], numbers[7 * 16 + lane] = 0.0, 0.0
                        numbers[8 * 16 + lane] = np.inf
                        words[9 * 16 + lane], words[10 * 16 + lane], words[11 * 16 + lane] = -1, 0, 0
                        for kept in range(GEOMETRY, INSTANCE + 2):
                            words[kept * 16 + lane] = -1
                        words[MASK * 16 + lane] = -1
                    intersect(here + MASK * 64, scene, here, arguments)
                    for lane in range(16):
                        x, y = (left + (lane & 3)) // side, (top + (lane >> 2)) // side
                        if x < out.shape[1] and y < out.shape[0]:
                            shade_hit(lane, numbers, words, tables, lights, lighting, color)
                            for c in range(4):
                                out[y, x, c] += share * color[c]

    return cast
