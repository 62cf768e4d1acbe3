"""Photo-consistency of a plane: weighted normalised cross-correlation of a window seen in two pictures.

The samples of the window are the lanes of short loops over one working memory, which compilers turn into vector
instructions; what depends on the reference only (`weigh`) is done once for all planes and views of a pixel.

Symbols: window of `LANES` samples at (dx, dy) around a pixel, weights w (sum 1), reference values r, neighbour's s;
cost = 1 - cov(r, s) / sqrt((var r + FLOOR) (var s + FLOOR)).
Source: schoenberger2016, sec. 4.2 (bilateral weights). Departures: a polynomial's sixteenth power instead of the
exponential; a floor under both variances, so that a window without texture costs about 1 whatever the plane.
"""

from __future__ import annotations

import math

import numpy as np

from ibrpipe.core.jit import fma, fused_exact

#: samples of a window
LANES = 32
#: rows of the working memory, LANES numbers each
DX, DY, SPACE, WEIGHT, PRODUCT, U, V, S = (LANES * n for n in range(8))
WORK = LANES * 8
#: cost where a view does not see the point
UNSEEN = np.float32(2.0)
#: variance that counts as no texture, grey levels squared (of 255)
FLOOR = np.float32(2.0)

ZERO, HALF, ONE, TINY = np.float32(0.0), np.float32(0.5), np.float32(1.0), np.float32(1e-6)
MINUS_HALF = np.float32(-0.5)
BYTE, TWO_BYTES, THREE_BYTES, LOW = np.uint32(8), np.uint32(16), np.uint32(24), np.uint32(255)


@fused_exact
def lay_window(window, work):
    # window (3, LANES) f32: dx, dy, exponent / 16 of the distance -> working memory
    for k in range(LANES):
        work[DX + k], work[DY + k], work[SPACE + k] = window[0, k], window[1, k], window[2, k]


@fused_exact
def folded(row, work):
    # sum of the LANES numbers from `row` on, halves added to halves, so that its order is the same everywhere
    for k in range(16):
        work[row + k] += work[row + 16 + k]
    for k in range(8):
        work[row + k] += work[row + 8 + k]
    for k in range(4):
        work[row + k] += work[row + 4 + k]
    return (work[row] + work[row + 2]) + (work[row + 1] + work[row + 3])


@fused_exact
def weigh(reference, i, j, softness, work):
    # weights of the window around (i, j) of the padded reference, and weight * (value - mean) -> variance
    centre = reference[i, j]
    for k in range(LANES):
        work[S + k] = reference[i + np.int64(work[DY + k]), j + np.int64(work[DX + k])]
    for k in range(LANES):
        apart = work[S + k] - centre
        w = ONE - apart * apart * softness - work[SPACE + k]
        w = w if w > ZERO else ZERO
        w = w * w
        w = w * w
        w = w * w
        w = w * w
        w = w if work[S + k] >= ZERO else ZERO
        work[WEIGHT + k], work[U + k] = w, w
    share = ONE / folded(U, work)
    for k in range(LANES):
        w = work[WEIGHT + k] * share
        work[WEIGHT + k], work[U + k] = w, w * work[S + k]
    mean = folded(U, work)
    for k in range(LANES):
        apart = work[S + k] - mean
        product = work[WEIGHT + k] * apart
        work[PRODUCT + k], work[U + k] = product, product * apart
    return folded(U, work)


@fused_exact
def project_samples(u0, v0, w0, ux, uy, vx, vy, wx, wy, right, bottom, work):
    # where the samples fall in the neighbour, in pixels from the centre of its first; kept inside it
    for k in range(LANES):
        w = ONE / fma(wx, work[DX + k], fma(wy, work[DY + k], w0))
        u = fma(fma(ux, work[DX + k], fma(uy, work[DY + k], u0)), w, MINUS_HALF)
        v = fma(fma(vx, work[DX + k], fma(vy, work[DY + k], v0)), w, MINUS_HALF)
        u = u if u > ZERO else ZERO
        v = v if v > ZERO else ZERO
        work[U + k] = u if u < right else right
        work[V + k] = v if v < bottom else bottom


@fused_exact
def fetch(pictures, n, pitch, work):
    # bilinear values of the samples; a word holds a pixel and its right, lower and lower right neighbour
    for k in range(LANES):
        u, v = work[U + k], work[V + k]
        left, top = np.float32(np.int32(u)), np.float32(np.int32(v))
        fu, fv = u - left, v - top
        four = pictures[n, np.uint32(np.int32(fma(top, pitch, left)))]
        s00 = np.float32(np.int32(four & LOW))
        s01 = np.float32(np.int32((four >> BYTE) & LOW))
        s10 = np.float32(np.int32((four >> TWO_BYTES) & LOW))
        s11 = np.float32(np.int32(four >> THREE_BYTES))
        upper = fma(fu, s01 - s00, s00)
        lower = fma(fu, s11 - s10, s10)
        work[S + k] = fma(fv, lower - upper, upper)


@fused_exact
def correlate(variance, work):
    # the cost, from the samples fetched and the reference's weights
    for k in range(LANES):
        s = work[S + k]
        ws = work[WEIGHT + k] * s
        work[U + k], work[V + k], work[S + k] = ws, ws * s, work[PRODUCT + k] * s
    mean, square, covariance = folded(U, work), folded(V, work), folded(S, work)
    spread = max(square - mean * mean, ZERO)
    return ONE - covariance / np.float32(math.sqrt((variance + FLOOR) * (spread + FLOOR)))


@fused_exact
def plane_cost(views, pictures, n, p0, p1, p2, q, a, b, variance, work):
    # cost of plane (q, a, b) in neighbour n; p = M (x, y, 1) of the pixel's centre
    m0, m1, m2 = views[n, 9], views[n, 10], views[n, 11]
    u0, v0, w0 = p0 + m0 * q, p1 + m1 * q, p2 + m2 * q
    cost = UNSEEN
    if w0 > TINY and u0 >= ZERO and v0 >= ZERO and u0 < views[n, 12] * w0 and v0 < views[n, 13] * w0:
        right, bottom = views[n, 12] - np.float32(1.001), views[n, 13] - np.float32(1.001)
        project_samples(
            u0, v0, w0, views[n, 0] + m0 * a, views[n, 1] + m0 * b, views[n, 3] + m1 * a, views[n, 4] + m1 * b,
            views[n, 6] + m2 * a, views[n, 7] + m2 * b, right, bottom, work,
        )  # fmt: skip
        fetch(pictures, n, views[n, 14], work)
        cost = correlate(variance, work)
    return cost
