"""Rays of a pinhole camera in the coordinates of one field, in float64.

A field's coordinates are homogeneous, ``(x, y, n, q) = P + t * Q``, ``Q = Q_of @ (px, py, 1)``, with camera depth t, so
that one code serves both kinds of frame: cells ``u = x/q``, ``v = y/q`` and depth ``d = n/q``. Parallel frames have q =
1 and d along f; perspective frames have q = z and n = -1, that is d = -1/z, in which rays and planes stay straight
(schaufler1999, eq. 1) and which also grows away from the camera.

Symbols: ``box = (columns, rows, least d, greatest d)``, u in [0, columns], v in [0, rows]; a clipped ray runs from A
(s = 0, t = ta) to B (s = 1, t = tb), ``t(s) = ta + (tb - ta) * s qa / ((1 - s) qb + s qa)``.
"""

from __future__ import annotations

import numpy as np

from ibrpipe.core.jit import inlined


@inlined
def clip_side(alpha, beta, near, far):
    # keep the part of [near, far] where alpha + t * beta >= 0
    if beta > 0.0:
        near = max(near, -alpha / beta)
    elif beta < 0.0:
        far = min(far, -alpha / beta)
    elif alpha < 0.0:
        far = -np.inf
    return near, far


@inlined
def clip_box(start, x, y, n, q, box, far):
    # start (4,), (x, y, n, q) change per t -> (ta, tb); the ray misses the box unless ta <= tb
    near = 0.0
    near, far = clip_side(start[0], x, near, far)
    near, far = clip_side(box[0] * start[3] - start[0], box[0] * q - x, near, far)
    near, far = clip_side(start[1], y, near, far)
    near, far = clip_side(box[1] * start[3] - start[1], box[1] * q - y, near, far)
    near, far = clip_side(start[2] - box[2] * start[3], n - box[2] * q, near, far)
    near, far = clip_side(box[3] * start[3] - start[2], box[3] * q - n, near, far)
    return near, far


@inlined
def patch_quadratic(start, direction, i, j, corners, near):
    # start, direction (x, y, n, q): a ray at t = 0 and per t; corners (a, b, c, e) depths of cell (i, j) at (0, 0),
    # (1, 0), (0, 1), (1, 1) -> (A, B, C): the ray meets the bilinear patch at t = near + s where A s^2 + B s + C = 0;
    # then its homogeneous position in the cell (u, v, q) at s = 0 and (du, dv, dq) per s
    a, b, c, e = corners
    dq = direction[3]
    du = direction[0] - i * dq
    dv = direction[1] - j * dq
    along_u, along_v, twist = b - a, c - a, a - b - c + e
    dl = direction[2] - a * dq - along_u * du - along_v * dv
    su, sv = start[0] - i * start[3], start[1] - j * start[3]
    u, v, q = su + near * du, sv + near * dv, start[3] + near * dq
    height = start[2] - a * start[3] - along_u * su - along_v * sv + near * dl
    A = dq * dl - twist * du * dv
    B = q * dl + dq * height - twist * (u * dv + v * du)
    C = q * height - twist * u * v
    return A, B, C, u, v, q, du, dv, dq


@inlined
def depth_at(s, near, far, qa, qb):
    # camera depth t of parameter s on the clipped ray
    return near + (far - near) * (s * qa) / ((1.0 - s) * qb + s * qa)
