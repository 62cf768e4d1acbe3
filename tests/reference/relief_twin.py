"""Slow plain twins of relief mapping: the published search in a box, ray by ray, in float64.

Written from ``docs/renderers/relief.md`` alone; nothing of the package's kernels is used.
"""

from __future__ import annotations

import numpy as np


def bilinear(height, u, v):
    """Height at (u, v), texel centres at whole numbers; outside the last texels the border cell goes on."""
    j, i = min(max(int(v), 0), height.shape[0] - 2), min(max(int(u), 0), height.shape[1] - 2)
    p, q = u - i, v - j
    (a, b), (c, e) = height[j : j + 2, i : i + 2].astype(float)
    return (a * (1 - p) + b * p) * (1 - q) + (c * (1 - p) + e * p) * q


def linear_binary(source, camera, steps, bisection_steps):
    """(H, W) float64 camera depth by `steps` equal steps through the box, then halving; outside is above the heights.

    Samples are taken where ``A + s B`` is rounded to float32, as the renderer does.
    """
    height, frame = source.height, source.frame
    into = np.linalg.inv(np.stack([frame.a, frame.b, frame.f], 1))
    start = into @ (camera.center - frame.origin) - (0.5, 0.5, 0.0)
    box = np.array([[0, 0, np.nanmin(height)], [height.shape[1] - 1, height.shape[0] - 1, np.nanmax(height)]], float)
    out = np.full((camera.height, camera.width), np.inf)
    for y, x in np.ndindex(out.shape):
        way = into @ camera.world_from_pixel @ (x + 0.5, y + 0.5, 1.0)
        with np.errstate(divide="ignore", invalid="ignore"):
            cuts = (box - start) / way
        t0, t1 = max(0.0, np.min(cuts, axis=0).max()), np.max(cuts, axis=0).min()
        if not t0 < t1:
            continue

        def inside(s, t0=t0, t1=t1, way=way):
            u, v, d = start + (t0 + s * (t1 - t0)) * way
            return d <= bilinear(height, u, v)

        for k in range(1, steps + 1):
            if inside(k / steps):
                s, size = (k - 1) / steps, 0.5 / steps
                for _ in range(bisection_steps):
                    s, size = s + (0.0 if inside(s + size) else size), size / 2
                out[y, x] = t0 + (s + size) * (t1 - t0)
                break
    return out
