"""Colour of pixels that surfaces one behind another cover in part.

A hit covers a share of its pixel, and those behind it share what is left. Hits less than a gap apart are one surface in
two textures: together they cover as much as the more covering of them.
"""

from __future__ import annotations

import numpy as np
from numba import prange

from ibrpipe.core.jit import kernel


@kernel
def mix_levels(depths, known, colors, gap, out_depth, out_known, out_color):
    # depths (L, h, w) f32, ascending, inf = no hit; known (L, h, w) f32: shares; colors (L, h, w, 3) f32; gap: scene
    # units -> out_depth (h, w) f32: of the hit at which half is covered, else the nearest; out_known (h, w) f32: share
    # covered; out_color (h, w, 3) f32: mean colour of what covers, 0 where nothing does
    levels = depths.shape[0]
    for y in prange(depths.shape[1]):
        for x in range(depths.shape[2]):
            left, own, seen, surface = np.float32(1.0), np.float32(0.0), np.float32(0.0), np.float32(-np.inf)
            red, green, blue = np.float32(0.0), np.float32(0.0), np.float32(0.0)
            out_depth[y, x] = depths[0, y, x]
            for level in range(levels):
                depth, share = depths[level, y, x], known[level, y, x]
                if not depth < np.inf:
                    break
                if depth - surface > gap:
                    left, own, surface = left * (np.float32(1.0) - own), np.float32(0.0), depth
                more = left * max(share - own, np.float32(0.0))
                own = max(own, share)
                if seen < np.float32(0.5) and seen + more >= np.float32(0.5):
                    out_depth[y, x] = depth
                seen += more
                red += more * colors[level, y, x, 0]
                green += more * colors[level, y, x, 1]
                blue += more * colors[level, y, x, 2]
            out_known[y, x] = min(seen, np.float32(1.0))
            scale = np.float32(1.0) / seen if seen > np.float32(0.0) else np.float32(0.0)
            out_color[y, x, 0], out_color[y, x, 1], out_color[y, x, 2] = red * scale, green * scale, blue * scale
