"""How far all rays of a tile of pixels run together before any of them can meet a height field.

At equal camera depth t the rays of a tile fill a parallelogram, the hull of the tile's corner rays; its bounding box
over a span of t is compared with the blocks of the pyramid that it touches. What this skips, no ray of the tile can
meet.

Symbols: ``start + t * (px, py, 1) @ Q_of`` position (u, v, d) of a ray in cells and depth; ``low, scale``: depth to
steps.
"""

from __future__ import annotations

import numpy as np

from ibrpipe.core.jit import fused, helper, inlined
from ibrpipe.core.rays import clip_side
from ibrpipe.core.relief.pyramid import THIRDS


@inlined
def span(first, second, third, fourth):
    # least and greatest of four
    return min(min(first, second), min(third, fourth)), max(max(first, second), max(third, fourth))


@helper
def touches(nodes, plan, level, i0, i1, j0, j1, near, far):
    # do depths near..far (steps) meet the bounds of any block i0..i1, j0..j1 of a level?
    top = (plan[2] * plan[3]) >> (2 * plan[4])
    first = top * (THIRDS & ((1 << (2 * (plan[4] - level))) - 1))
    columns = plan[3] >> level
    for j in range(j0, j1 + 1):
        for i in range(i0, i1 + 1):
            node = nodes[first + j * columns + i]
            least, greatest = np.int64(node & np.uint32(0xFFFF)), np.int64(node >> np.uint32(16))
            if least <= greatest and near <= greatest and far >= least:
                return True
    return False


@helper
def beam_start(nodes, plan, low, scale, bottom, top, start, directions, most):
    # directions (12,): directions (u, v, d) of the corner rays; bottom, top: depth range of the field; most: blocks
    # that a test may touch along one axis -> (t, end): no ray of the tile meets the field before t or after end
    u0, u1 = span(directions[0], directions[3], directions[6], directions[9])
    v0, v1 = span(directions[1], directions[4], directions[7], directions[10])
    d0, d1 = span(directions[2], directions[5], directions[8], directions[11])
    rows, columns = float(plan[0]), float(plan[1])
    t, end = clip_side(start[0], u1, 0.0, np.inf)
    t, end = clip_side(columns - start[0], -u0, t, end)
    t, end = clip_side(start[1], v1, t, end)
    t, end = clip_side(rows - start[1], -v0, t, end)
    t, end = clip_side(start[2] - bottom, d1, t, end)
    t, end = clip_side(top - start[2], -d0, t, end)
    fast = max(max(abs(u0), abs(u1)), max(abs(v0), abs(v1)))
    level = plan[4]
    tiny = 1e-12 * (end - t) if end < np.inf else 0.0
    while t < end:
        step = float(1 << level) / max(fast, 1e-200)
        to = min(t + max(step, tiny), end)
        ua, ub = start[0] + min(t * u0, to * u0), start[0] + max(t * u1, to * u1)
        va, vb = start[1] + min(t * v0, to * v0), start[1] + max(t * v1, to * v1)
        da, db = start[2] + min(t * d0, to * d0), start[2] + max(t * d1, to * d1)
        i0, i1 = np.int64(max(ua - 1e-6, 0.0)) >> level, np.int64(min(max(ub + 1e-6, 0.0), columns - 1.0)) >> level
        j0, j1 = np.int64(max(va - 1e-6, 0.0)) >> level, np.int64(min(max(vb + 1e-6, 0.0), rows - 1.0)) >> level
        crowded = i1 - i0 >= most or j1 - j0 >= most
        near, far = (da - low) * scale - 1.0, (db - low) * scale + 1.0
        if crowded and level < plan[4]:
            return t, end
        if touches(nodes, plan, level, i0, i1, j0, j1, near, far):
            if level == 0:
                return t, end
            level -= 1
        else:
            t = to
            level = min(level + 1, plan[4])
    return t, end


@fused
def corner_directions(Q_of, x0, y0, x1, y1, directions):
    # directions (u, v, d) of the rays through the corners of a tile of pixels -> directions (12,)
    for c in range(4):
        x = x1 if c & 1 else x0
        y = y1 if c & 2 else y0
        for axis in range(3):
            directions[3 * c + axis] = Q_of[3 * axis] * x + Q_of[3 * axis + 1] * y + Q_of[3 * axis + 2]


@inlined
def clip_ray(Q_of, start, px, py, least, columns, rows, bottom, top):
    # the ray at (px, py) in the picture, from camera depth `least` on, cut off at the field's box -> its direction
    # (u, v, d) per camera depth, camera depth where it enters, camera depth from there to where it leaves, is it in
    # the box at all; where it is not, all is 0 and the length -1: no overflow, no NaN
    x = Q_of[0] * px + Q_of[1] * py + Q_of[2]
    y = Q_of[3] * px + Q_of[4] * py + Q_of[5]
    z = Q_of[6] * px + Q_of[7] * py + Q_of[8]
    ix, iy, iz = (
        1.0 / (x if abs(x) > 1e-200 else 1e-200),
        1.0 / (y if abs(y) > 1e-200 else 1e-200),
        1.0 / (z if abs(z) > 1e-200 else 1e-200),
    )
    xa, xb = -start[0] * ix, (columns - start[0]) * ix
    ya, yb = -start[1] * iy, (rows - start[1]) * iy
    za, zb = (bottom - start[2]) * iz, (top - start[2]) * iz
    near = max(max(min(xa, xb), min(ya, yb)), max(min(za, zb), least))
    far = min(min(max(xa, xb), max(ya, yb)), max(za, zb))
    met = near <= far
    length = far - near if met else -1.0
    near = near if met else 0.0
    x, y, z = x if met else 0.0, y if met else 0.0, z if met else 0.0
    return x, y, z, near, length, met
