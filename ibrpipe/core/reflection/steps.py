"""Sums of the chunks' gradients in a fixed order, and one step of Adam. Source: kingma2015, algorithm 1."""

import math

from numba import prange

from ibrpipe.core.jit import exact_kernel

BLOCK = 4096
#: decay of the first and second moment, and what keeps a step finite
FIRST, SECOND, TINY = 0.9, 0.99, 1e-12


@exact_kernel
def sum_texels(chunks, counts, parts, out):
    """Add the chunks' gradients, in the order of the chunks, into out (S, K) f32."""
    # chunks (C, 4) as in model.add_gradients; counts (C,) i64 samples that each touches; parts (G, K) f32
    for block in prange((len(out) + BLOCK - 1) // BLOCK):
        begin, end = block * BLOCK, min(block * BLOCK + BLOCK, len(out))
        for i in range(begin, end):
            for k in range(out.shape[1]):
                out[i, k] = 0.0
        for chunk in range(len(chunks)):
            low, shift = chunks[chunk, 2], chunks[chunk, 3] - chunks[chunk, 2]
            for i in range(max(begin, low), min(end, low + counts[chunk])):
                for k in range(out.shape[1]):
                    out[i, k] += parts[i + shift, k]


@exact_kernel
def sum_tables(parts, out):
    """Add the chunks' gradients (C, L, M, 3) f32, in the order of the chunks, into out (L, M, 3) f32."""
    layers, cells = out.shape[0], out.shape[1]
    for cell in prange(cells):
        for table in range(layers):
            for channel in range(3):
                total = 0.0
                for chunk in range(parts.shape[0]):
                    total += parts[chunk, table, cell, channel]
                out[table, cell, channel] = total


@exact_kernel
def adam_step(values, gradient, first, second, rates, lows, count):
    """Move values (N, K) f32 against their gradient, in place, and keep them above `lows`."""
    # first, second (N, K) f32 moments, updated; rates, lows (K,) f64; count: 1 for the first step
    bias = math.sqrt(1.0 - SECOND**count) / (1.0 - FIRST**count)
    for block in prange((len(values) + BLOCK - 1) // BLOCK):
        for i in range(block * BLOCK, min(block * BLOCK + BLOCK, len(values))):
            for k in range(values.shape[1]):
                slope = float(gradient[i, k])
                m = FIRST * first[i, k] + (1.0 - FIRST) * slope
                v = SECOND * second[i, k] + (1.0 - SECOND) * slope * slope
                first[i, k], second[i, k] = m, v
                values[i, k] = max(values[i, k] - rates[k] * bias * m / (math.sqrt(v) + TINY), lows[k])
