"""The pre-warping equations in float64. Source: oliveira2000, eqs. 4a and 4b, and the coefficients that follow them.

A parallel image has origin C, texel vectors a, b, and counts displacements d along f, ``X = C + u a + v b + d f``.
With c = C - eye, ``k1 = f.(b x c) / a.(b x c)``, ``k2 = f.(c x a) / b.(c x a)``; the paper's ``k3 = 1 / (c.f)`` needs f
normal to a and b, for any f it is ``k3 = f.(a x b) / c.(a x b)``. Only the eye matters, not the camera's pose.
"""

from __future__ import annotations

import numpy as np


def coefficients(c, a, b, f):
    # c, a, b, f (3,) f64 -> k1, k2, k3; infinite where the eye lies in the image plane (c.(a x b) = 0)
    c, a, b, f = (np.asarray(each, np.float64) for each in (c, a, b, f))
    with np.errstate(divide="ignore", invalid="ignore"):
        k1 = np.dot(f, np.cross(b, c)) / np.dot(a, np.cross(b, c))
        k2 = np.dot(f, np.cross(c, a)) / np.dot(b, np.cross(c, a))
        k3 = np.dot(f, np.cross(a, b)) / np.dot(c, np.cross(a, b))
    return float(k1), float(k2), float(k3)


def prewarped(u, v, d, k):
    # u, v, d (...) f64 and k from `coefficients` -> u_i, v_i (...); NaN where the texel is at or behind the eye's plane
    k1, k2, k3 = k
    ahead = 1.0 + k3 * np.asarray(d, np.float64)
    ahead = np.where(ahead > 0, ahead, np.nan)
    return (u + k1 * d) / ahead, (v + k2 * d) / ahead


def plane_homography(origin, a, b, project):
    # project (3, 4): world to homogeneous pixels -> (3, 3) from (u, v, 1) of the image plane to homogeneous pixels
    world = np.zeros((4, 3))
    world[:3] = np.stack([a, b, origin], axis=1)
    world[3, 2] = 1.0
    return np.asarray(project, np.float64) @ world
