"""Colour of a surface under shared reflection, and its gradients.

``C = (1 - damping s) D + sum_l k_l (f_l + (1 - f_l) s) E_l(r)`` with ``s = (1 - n.v)^5`` and ``r = 2 (n.v) n - v``.
D and k are bilinear between the samples of a patch, E_l in an octahedral table (:mod:`ibrpipe.core.reflection.
directions`). D and E are kept as square roots, so that light stays positive and dark and bright errors weigh alike.

Symbols: an *observation* is a patch and a table cell (two numbers) and `TRAITS` floats: position (p, q) in the patch,
s, position (fx, fy) in the table cell, weight, square root of the observed colour (3; negative where the photo is
clipped and only says "at least"), and mirrored colour (3; NaN where the reflected ray leaves the object and the tables
count). `texels` (S, 3 or 3 + L): square root of D, then k_l (all 1 where they are missing). `tables` (L, M, 3): square
roots, padded, M = (n + 2)^2. `law`: damping, Huber's bend, f_l. Sources: schlick1994 for s; huber1964.
"""

import math

import numpy as np
from numba import prange

from ibrpipe.core.jit import exact_kernel, fused_exact

TRAITS = 12
#: samples of a patch, most tables, channels
CORNERS, TABLES, CHANNELS = 4, 2, 3
#: added to light before its root is taken, so that black has a slope
DARK = 1e-6
BLOCK = 256


#: of float32, so that `mirror` computes in the precision that it is given
NONE, ONE, TWO = np.float32(0.0), np.float32(1.0), np.float32(2.0)


@fused_exact
def mirror(nx, ny, nz, vx, vy, vz):
    """Direction r that a mirror of unit normal n looks along for an eye in the unit direction v, and s; no branches."""
    cosine = nx * vx + ny * vy + nz * vz
    cosine = cosine if cosine > NONE else NONE
    cosine = cosine if cosine < ONE else ONE
    twice, off = TWO * cosine, ONE - cosine
    return twice * nx - vx, twice * ny - vy, twice * nz - vz, off * off * (off * off) * off


@fused_exact
def corner_weights(samples, p, q, out):
    """Fill out (4,) with the bilinear weights of a patch's corners over those that are samples; False if none is."""
    # corner: bit 0 along p, bit 1 along q; samples (4,) i32, -1 = none
    total = 0.0
    for c in range(4):
        weight = (p if c & 1 else 1.0 - p) * (q if c & 2 else 1.0 - q)
        out[c] = weight if samples[c] >= 0 else 0.0
        total += out[c]
    if not total > 0.0:
        return False
    for c in range(4):
        out[c] /= total
    return True


@fused_exact
def mix_texels(texels, samples, weights, out):
    """Fill out (3[+ L],) with the light of D and the k_l of a position: bilinear between samples."""
    for k in range(texels.shape[1]):
        out[k] = 0.0
    for c in range(CORNERS):
        if weights[c] > 0.0:
            for k in range(texels.shape[1]):
                value = float(texels[samples[c], k])
                out[k] += weights[c] * (value * value if k < CHANNELS else value)


@fused_exact
def table_light(table, cell, width, fx, fy, channel):
    """Light of one channel in a padded table of square roots (M, 3); cell: its nearer corner."""
    a, b = float(table[cell, channel]), float(table[cell + 1, channel])
    c, d = float(table[cell + width, channel]), float(table[cell + width + 1, channel])
    upper = (1.0 - fx) * a * a + fx * b * b
    lower = (1.0 - fx) * c * c + fx * d * d
    return (1.0 - fy) * upper + fy * lower


@fused_exact
def gather_lights(traits, tables, cell, width, out):
    """Fill out (L, 3) with what the surface mirrors: the tables' light, or the object's own."""
    for table in range(tables.shape[0]):
        for channel in range(CHANNELS):
            own = traits[9 + channel]
            if math.isnan(own):
                own = table_light(tables[table], cell, width, traits[3], traits[4], channel)
            out[table, channel] = own


@exact_kernel
def predict(where, traits, corners, texels, tables, law, out_color):
    """Colour of every observation: out_color (N, 3) f32, linear; NaN where its patch has no sample."""
    # where (N, 2) i32 patch, cell; traits (N, 12) f32; corners (P, 4) i32; texels, tables f32; law (2 + L,) f64
    layers, width = tables.shape[0], int(math.sqrt(tables.shape[1]) + 0.5)
    for block in prange((len(where) + BLOCK - 1) // BLOCK):
        weights, mixed, lights = np.empty(CORNERS), np.empty(CHANNELS + TABLES), np.empty((TABLES, CHANNELS))
        for i in range(block * BLOCK, min(block * BLOCK + BLOCK, len(where))):
            samples, s = corners[where[i, 0]], traits[i, 2]
            if not corner_weights(samples, traits[i, 0], traits[i, 1], weights):
                out_color[i, 0], out_color[i, 1], out_color[i, 2] = np.nan, np.nan, np.nan
                continue
            mix_texels(texels, samples, weights, mixed)
            gather_lights(traits[i], tables, where[i, 1], width, lights)
            for channel in range(CHANNELS):
                light = (1.0 - law[0] * s) * mixed[channel]
                for table in range(layers):
                    f = law[2 + table]
                    share = mixed[CHANNELS + table] if texels.shape[1] > CHANNELS else 1.0
                    light += share * (f + (1.0 - f) * s) * lights[table, channel]
                out_color[i, channel] = light


@fused_exact
def add_texel_gradient(out, texels, samples, weights, shift, slopes):
    """Add to out (G, 3[+ L]) what slopes (3[+ L],), d loss / d light and k of a position, mean for its samples."""
    for c in range(CORNERS):
        if weights[c] > 0.0:
            row = samples[c] + shift
            for k in range(CHANNELS):
                out[row, k] += np.float32(2.0 * slopes[k] * weights[c] * texels[samples[c], k])
            for k in range(CHANNELS, texels.shape[1]):
                out[row, k] += np.float32(slopes[k] * weights[c])


@fused_exact
def add_table_gradient(out, table, cell, width, fx, fy, slopes):
    """Add to out (M, 3) what slopes (3,), d loss / d light of a position, mean for its four cells."""
    for c in range(4):
        at = cell + (c & 1) + (c >> 1) * width
        weight = 2.0 * (fx if c & 1 else 1.0 - fx) * (fy if c & 2 else 1.0 - fy)
        for channel in range(CHANNELS):
            out[at, channel] += np.float32(slopes[channel] * weight * table[at, channel])


@fused_exact
def bent_slope(light, seen, limit):
    """Huber's slope of the error in square roots; 0 where a clipped photo (negative) is exceeded."""
    error = math.sqrt(light + DARK) - abs(seen)
    if seen < 0.0 and error > 0.0:
        return 0.0, 0.0
    slope = min(max(error, -limit), limit)
    return slope, slope * (error - 0.5 * slope)


@exact_kernel
def add_gradients(
    where, traits, chunks, corners, texels, tables, law, out_texels, out_tables, out_loss
):  # fmt: skip
    """Sum loss and gradients over chunks of observations, each chunk into memory of its own, which must be zero."""
    # arrays as in `predict`; chunks (C, 4) i64: first and last (exclusive) observation, first sample that they touch,
    # first row of the chunk in out_texels (G, as texels) f32; out_tables (C, L, M, 3) f32; out_loss (C, 2) f64: loss
    # and weight
    layers, width = tables.shape[0], int(math.sqrt(tables.shape[1]) + 0.5)
    for chunk in prange(len(chunks)):
        weights, mixed, lights = np.empty(CORNERS), np.empty(CHANNELS + TABLES), np.empty((TABLES, CHANNELS))
        slopes, back, strength = np.empty(CHANNELS + TABLES), np.empty(CHANNELS), np.empty(TABLES)
        shift = chunks[chunk, 3] - chunks[chunk, 2]
        loss, mass = 0.0, 0.0
        for i in range(chunks[chunk, 0], chunks[chunk, 1]):
            samples, s, weight = corners[where[i, 0]], traits[i, 2], traits[i, 5]
            if not corner_weights(samples, traits[i, 0], traits[i, 1], weights):
                continue
            mass += weight
            mix_texels(texels, samples, weights, mixed)
            gather_lights(traits[i], tables, where[i, 1], width, lights)
            for table in range(layers):
                strength[table] = law[2 + table] + (1.0 - law[2 + table]) * s
                slopes[CHANNELS + table] = 0.0
                if texels.shape[1] == CHANNELS:
                    mixed[CHANNELS + table] = 1.0
            for channel in range(CHANNELS):
                light = (1.0 - law[0] * s) * mixed[channel]
                for table in range(layers):
                    light += mixed[CHANNELS + table] * strength[table] * lights[table, channel]
                slope, cost = bent_slope(light, traits[i, 6 + channel], law[1])
                loss += weight * cost
                back[channel] = 0.5 * weight * slope / math.sqrt(light + DARK)
                slopes[channel] = back[channel] * (1.0 - law[0] * s)
                for table in range(layers):
                    slopes[CHANNELS + table] += back[channel] * strength[table] * lights[table, channel]
            add_texel_gradient(out_texels, texels, samples, weights, shift, slopes)
            if not math.isnan(traits[i, 9]):
                continue
            for table in range(layers):
                for channel in range(CHANNELS):
                    slopes[channel] = back[channel] * mixed[CHANNELS + table] * strength[table]
                add_table_gradient(
                    out_tables[chunk, table], tables[table], where[i, 1], width, traits[i, 3], traits[i, 4], slopes
                )
        out_loss[chunk, 0], out_loss[chunk, 1] = loss, mass
