"""Slopes of a picture with holes: the plane that fits a sample and its neighbours on the same surface best.

The plane goes through the sample itself: least squares over the 5 x 5 texels around it, but those that are too far off
for one surface. One thread: pictures are coded side by side by threads of their own.
"""

from __future__ import annotations

import math

import numpy as np

from ibrpipe.core.jit import exact_serial

#: texels on either side that count
REACH = 2


@exact_serial
def fit_slopes(values, there, steepest, relative, out_slopes):
    # values (H, W) f64; there (H, W) bool; steepest: difference per texel that may still be one surface, times the
    # value itself where relative; out_slopes (H, W, 2) f64: per column, per row; 0 where neighbours do not tell
    for i in range(values.shape[0]):
        for j in range(values.shape[1]):
            uu, uv, vv, uz, vz = 0.0, 0.0, 0.0, 0.0, 0.0
            if there[i, j]:
                limit = steepest * (values[i, j] if relative else 1.0)
                for y in range(max(i - REACH, 0), min(i + REACH + 1, values.shape[0])):
                    for x in range(max(j - REACH, 0), min(j + REACH + 1, values.shape[1])):
                        du, dv, dz = float(x - j), float(y - i), values[y, x] - values[i, j]
                        if there[y, x] and abs(dz) <= limit * math.sqrt(du * du + dv * dv):
                            uu += du * du
                            uv += du * dv
                            vv += dv * dv
                            uz += du * dz
                            vz += dv * dz
            size = uu * vv - uv * uv
            out_slopes[i, j, 0] = (vv * uz - uv * vz) / size if size > 0 else 0.0
            out_slopes[i, j, 1] = (uu * vz - uv * uz) / size if size > 0 else 0.0


def slopes(values, there, steepest, relative):
    """Return the slopes (H, W, 2) float64 of `fit_slopes`."""
    found = np.zeros((*there.shape, 2))
    fit_slopes(values, there, steepest, relative, found)
    return found
