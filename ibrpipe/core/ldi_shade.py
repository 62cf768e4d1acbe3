"""Colour of hits: bilinear in the cell, weights renormalised over the corners that are samples."""

from __future__ import annotations

from numba import prange

from ibrpipe.core.jit import kernel


@kernel
def shade_heights(index, number, patches, places, window, color, out):
    # color (H, W, 3) f32 texels; patches holds cell numbers; out (h, w, 3) f32 where index == number
    columns = color.shape[1] - 1
    for y in prange(window[2], window[3]):
        for x in range(window[0], window[1]):
            if index[y, x] == number:
                row, column = patches[y, x] // columns, patches[y, x] % columns
                p, q = places[y, x, 0], places[y, x, 1]
                for k in range(3):
                    upper = color[row, column, k] + p * (color[row, column + 1, k] - color[row, column, k])
                    lower = color[row + 1, column, k] + p * (color[row + 1, column + 1, k] - color[row + 1, column, k])
                    out[y, x, k] = upper + q * (lower - upper)


@kernel
def shade_patches(index, number, patches, places, window, samples, color, out):
    # samples (P, 4) i32, color (S, 3) f32; out (h, w, 3) f32 where index == number
    for y in prange(window[2], window[3]):
        for x in range(window[0], window[1]):
            if index[y, x] == number:
                p, q = places[y, x, 0], places[y, x, 1]
                total, red, green, blue = 0.0, 0.0, 0.0, 0.0
                for corner in range(4):
                    sample = samples[patches[y, x], corner]
                    if sample >= 0:
                        weight = (p if corner & 1 else 1.0 - p) * (q if corner & 2 else 1.0 - q)
                        total += weight
                        red += weight * color[sample, 0]
                        green += weight * color[sample, 1]
                        blue += weight * color[sample, 2]
                out[y, x, 0], out[y, x, 1], out[y, x, 2] = red / total, green / total, blue / total
