"""The sampled searches where a ray's path is short in the reference: about the epipole, and right before the eye.

There a line has no columns to step by: within the field's depths a ray moves by less than `SHORT` texels, and by none
at all where both centres coincide. Such a ray walks from texel to texel instead (as schaufler1999, sec. 4, does
everywhere); so does every ray on its first `SHORT` texels where the eye itself is within the field.

At field depth d a ray is at ``(u, v) = origin + d W / g``, with W of :mod:`ibrpipe.core.epipolar.lines` and g the
change per camera depth of d (parallel frames) or of z = -1/d (perspective ones).

Symbols: P, Q of :mod:`ibrpipe.core.rays`; samples lie where u and v are whole numbers; NaN = background.

Packed arguments of the sampled searches: ``raster`` (flat (rows * stride,) f32 samples, stride, steps (3,): greatest
step within a surface, a constant and a share of the depth, and from which side it is seen: 1 = where rays pass to
greater depth, -1 = to lesser, 0 = either); ``view`` (start (4,), Q_of (4, 3), weight (4,): (u, v, d,
1) to camera depth (perspective: over own z), perspective).
"""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from ibrpipe.core.jit import helper, inlined, kernel

#: texels of the reference up to which a ray's path is short; bisection steps through the texel that is met
SHORT, BISECTION_STEPS = 2.0, 24


@inlined
def is_short(wu, wv, g, reach):
    # reach: range of the field's depths
    return max(abs(wu), abs(wv)) * reach <= SHORT * abs(g)


@inlined
def joined(one, other, steps):
    # are two samples of one surface; steps (2,): greatest step within a surface, a constant and a share of the depth
    return abs(one - other) <= steps[0] + steps[1] * max(abs(one), abs(other))


@helper
def depth_in_texel(u, v, i, j, linear, flat, rows, stride, steps):
    # sample of texel (i, j), or (linear) the mean of those of its surface about the position, NaN = background; a
    # height field, which has no greatest step, is nowhere where one of the four samples about the position is missing
    if i < 0 or j < 0 or i >= stride or j >= rows:
        return np.nan
    middle = float(flat[j * stride + i])
    if not linear or middle != middle:
        return middle
    left = i if u >= i else i - 1
    top = j if v >= j else j - 1
    total, value = 0.0, 0.0
    for corner in range(4):
        m, n = left + (corner & 1), top + (corner >> 1)
        share = max(1.0 - abs(u - m), 0.0) * max(1.0 - abs(v - n), 0.0)
        sample = float(flat[n * stride + m]) if 0 <= m < stride and 0 <= n < rows else np.nan
        if joined(sample, middle, steps):
            total += share
            value += share * sample
        elif steps[0] == np.inf and share > 0.0:
            return np.nan
    return value / total


@helper
def cross_short(u, v, du, dv, first, last, linear, flat, rows, stride, steps):
    # (u, v) + d (du, dv) for d from `first` to `last` -> (d, i, j) where a surface is first crossed; d is NaN for none
    span = last - first
    u, v, du, dv = u + first * du, v + first * dv, span * du, span * dv
    i, j, s = int(math.floor(u + 0.5)), int(math.floor(v + 0.5)), 0.0
    before, over = np.nan, np.nan
    for _ in range(4 * int(SHORT) + 8):
        leave_u = (i + math.copysign(0.5, du) - u) / du if du != 0.0 else np.inf
        leave_v = (j + math.copysign(0.5, dv) - v) / dv if dv != 0.0 else np.inf
        leave = max(min(min(leave_u, leave_v), 1.0), s)
        value = depth_in_texel(u + s * du, v + s * dv, i, j, linear, flat, rows, stride, steps)
        above = first + s * span - value
        if above * over <= 0.0 and (above - over) * steps[2] >= 0.0 and joined(value, before, steps):  # a step is met
            return first + s * span, i, j
        before = depth_in_texel(u + leave * du, v + leave * dv, i, j, linear, flat, rows, stride, steps)
        over = first + leave * span - before
        if above * over <= 0.0 and (over - above) * steps[2] >= 0.0:
            near, far = s, leave
            for _ in range(BISECTION_STEPS):
                s = 0.5 * (near + far)
                value = depth_in_texel(u + s * du, v + s * dv, i, j, linear, flat, rows, stride, steps)
                if (first + s * span - value) * above > 0.0:
                    near = s
                else:
                    far = s
            return first + 0.5 * (near + far) * span, i, j
        if leave >= 1.0:
            break
        if leave_u <= leave_v:
            i += 1 if du > 0.0 else -1
        else:
            j += 1 if dv > 0.0 else -1
        s = leave
    return np.nan, i, j


@kernel
def meet_near(raster, view, linear, within, ends, eye, base, depth, ids):
    # within: the eye may be within the field; ends (2,): least and greatest depth of the samples; depth (h, w) f32 and
    # ids (h, w) u32 are lowered in place
    flat, stride, steps = raster
    start, Q_of, weight, perspective = view
    rows = len(flat) // stride
    for y in prange(depth.shape[0]):
        for x in range(depth.shape[1]):
            px, py = x + 0.5, y + 0.5
            a = Q_of[0, 0] * px + Q_of[0, 1] * py + Q_of[0, 2]
            b = Q_of[1, 0] * px + Q_of[1, 1] * py + Q_of[1, 2]
            n = Q_of[2, 0] * px + Q_of[2, 1] * py + Q_of[2, 2]
            q = Q_of[3, 0] * px + Q_of[3, 1] * py + Q_of[3, 2]
            wu, wv, g = start[3] * a - q * start[0], start[3] * b - q * start[1], q if perspective else n
            near = is_short(wu, wv, g, ends[1] - ends[0])
            if g == 0.0 or not (near or within):
                continue
            here = start[2] / start[3] if start[3] > 0.0 else -np.inf
            first = max(ends[0], here) if g > 0.0 else min(ends[1], here)
            last = ends[1] if g > 0.0 else ends[0]
            du, dv = wu / g, wv / g
            if not near:
                most = first + math.copysign(SHORT / max(abs(du), abs(dv)), g)
                last = min(last, most) if g > 0.0 else max(last, most)
            if not (last - first) * g > 0.0:
                continue
            u = a / q if perspective else start[0] - start[2] * a / n
            v = b / q if perspective else start[1] - start[2] * b / n
            d, i, j = cross_short(u, v, du, dv, first, last, linear, flat, rows, stride, steps)
            if d != d:
                continue
            t = (-1.0 / d - start[3]) / q if perspective else (d - start[2]) / n
            if not linear:
                value = float(flat[j * stride + i])
                own = weight[0] * i + weight[1] * j + weight[2] * value + weight[3]
                own = -own / value if perspective else own
                t = own if own > eye else t  # a sample behind the eye is shown where the ray meets its texel
            t = np.float32(t)
            if t > eye and t < depth[y, x]:
                depth[y, x], ids[y, x] = t, np.uint32(base + j * stride + i)
