"""Light on prefiltered texels: the mean of max(0, n.L) over normals of which two moments are known.

Source: max1999, sec. 3 (shading after reprojection, ambient + diffuse); the mean over a texel goes beyond it. The
cosines n.L of a texel are taken as normally distributed with their true mean and variance.
"""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from ibrpipe.core.jit import helper, kernel

#: half the width and entries of the table of the mean of max(0, t + x), x normally distributed
_REACH, _ENTRIES = 4.0, 256


def _rectified_table():
    t = np.linspace(-_REACH, _REACH, _ENTRIES + 1)
    below = np.array([0.5 * (1.0 + math.erf(each / math.sqrt(2.0))) for each in t])
    return (t * below + np.exp(-0.5 * t * t) / math.sqrt(2.0 * math.pi)).astype(np.float32)


RECTIFIED = _rectified_table()


@helper
def mean_cosine(moments, first, lx, ly, lz):
    # moments[first:] = mean n (3), xx, yy, xy, xz, yz -> mean of max(0, n.l)
    mean = moments[first] * lx + moments[first + 1] * ly + moments[first + 2] * lz
    xx, yy = moments[first + 3], moments[first + 4]
    square = xx * lx * lx + yy * ly * ly + max(1.0 - xx - yy, 0.0) * lz * lz
    square += 2.0 * (moments[first + 5] * lx * ly + moments[first + 6] * lx * lz + moments[first + 7] * ly * lz)
    deviation = math.sqrt(max(square - mean * mean, 1e-12))
    t = (mean / deviation + _REACH) * (_ENTRIES / (2.0 * _REACH))
    if not t > 0.0:
        return 0.0
    if t >= _ENTRIES:
        return mean
    cell = int(t)
    return deviation * (RECTIFIED[cell] + (t - cell) * (RECTIFIED[cell + 1] - RECTIFIED[cell]))


@helper
def mean_highlight(moments, first, hx, hy, hz, shininess):
    # -> mean of max(0, n.h) ** shininess: a Gaussian lobe in 1 - n.h, widened by the spread of the normals
    mean = moments[first] * hx + moments[first + 1] * hy + moments[first + 2] * hz
    length = moments[first] ** 2 + moments[first + 1] ** 2 + moments[first + 2] ** 2
    if not mean > 0.0 or not length > 1e-6:
        return 0.0
    spread = max(1.0 - length, 0.0) * 0.5
    cosine = min(mean / math.sqrt(length), 1.0)
    width = 1.0 / shininess + spread
    return math.exp((cosine - 1.0) / width) / (shininess * width)


@helper
def irradiance(moments, first, lights, colors, ambient, out):
    # lights (N, 3) f64, not longer than 1 by much; colors (N, 3), ambient (3,) -> out (3,)
    out[0], out[1], out[2] = ambient[0], ambient[1], ambient[2]
    for n in range(len(lights)):
        cosine = mean_cosine(moments, first, lights[n, 0], lights[n, 1], lights[n, 2])
        for c in range(3):
            out[c] += colors[n, c] * cosine


@helper
def bin_direction(cell, size, out):
    # middle of a cell of a square octahedral map (cigolle2014) -> out (3,) unit
    u = (cell % size + 0.5) * 2.0 / size - 1.0
    v = (cell // size + 0.5) * 2.0 / size - 1.0
    z = 1.0 - abs(u) - abs(v)
    if z < 0.0:
        u, v = (1.0 - abs(v)) * (1.0 if u >= 0.0 else -1.0), (1.0 - abs(u)) * (1.0 if v >= 0.0 else -1.0)
    length = math.sqrt(u * u + v * v + z * z)
    out[0], out[1], out[2] = u / length, v / length, z / length


@helper
def lights_of_key(key, count, size, out):
    # the directions (count, 3) of the bins of 8 bits each that a key holds
    for n in range(count):
        bin_direction((key >> (8 * n)) & 255, size, out[n])


@helper
def texel_moments(texels, at, scale, moments):
    # -> moments (12,): coverage, albedo (3) linear, n (3), xx, yy, xy, xz, yz
    moments[0] = texels[at, 0] / 255.0
    for c in range(3):
        root = texels[at, 1 + c] / 255.0
        moments[1 + c] = scale * root * root
        moments[4 + c] = (texels[at, 4 + c] - 128.0) / 127.0
        moments[9 + c] = (texels[at, 9 + c] - 128.0) / 254.0
    for c in range(2):
        moments[7 + c] = texels[at, 7 + c] / 255.0


@helper
def shaded(moments, lights, colors, ambient, viewer, material, light):
    # -> light (3,) that a texel sends to the viewer; viewer (3,) unit; material (2,): specular, shininess
    irradiance(moments, 4, lights, colors, ambient, light)
    for c in range(3):
        light[c] *= moments[1 + c]
    if material[0] > 0.0:
        for n in range(len(lights)):
            hx, hy, hz = lights[n, 0] + viewer[0], lights[n, 1] + viewer[1], lights[n, 2] + viewer[2]
            length = math.sqrt(hx * hx + hy * hy + hz * hz)
            if length > 1e-9:
                lobe = material[0] * mean_highlight(moments, 4, hx / length, hy / length, hz / length, material[1])
                for c in range(3):
                    light[c] += colors[n, c] * lobe


@kernel
def shade_stacks(wanted, slots, stacks, slabs, texels, materials, viewers, lighting, scale, out, peaks):
    # wanted (N, 2) i64: stack, key of its lights; slots (N,) i64: first texel in out; stacks (T + 1,) i64: first slab
    # slabs (S, 7) i64: u, v, width, height, first texel, first texel with borders (from the stack's), node
    # materials (P, 2) f64; viewers (D, 3) f64; lighting (1 + lights, 3) f64: ambient, then colours; a stack's
    # direction is its number modulo D
    # -> out (M,) u32: red, green, blue (premultiplied), coverage, from the lowest byte; a border of 0 round each slab
    # -> peaks (N,) f32: what byte 255 of the colours means
    for n in prange(len(wanted)):
        stack, key = wanted[n, 0], wanted[n, 1]
        lights = np.empty((len(lighting) - 1, 3))
        lights_of_key(key, len(lights), 16, lights)
        moments, light = np.empty(12), np.empty(3)
        viewer = viewers[stack % len(viewers)]
        peak = 1e-9
        for turn in range(2):
            for s in range(stacks[stack], stacks[stack + 1]):
                at, width, height = slabs[s, 4], slabs[s, 2], slabs[s, 3]
                goal = slots[n] + slabs[s, 5]
                stride = width + 2
                if turn == 1:
                    for i in range(stride * (height + 2)):
                        out[goal + i] = 0
                for v in range(height):
                    for u in range(width):
                        if texels[at, 0] > 0:
                            texel_moments(texels, at, scale, moments)
                            shaded(moments, lights, lighting[1:], lighting[0], viewer, materials[slabs[s, 6]], light)
                            if turn == 0:
                                peak = max(peak, light[0], light[1], light[2])
                            else:
                                packed = np.uint32(texels[at, 0]) << 24
                                for c in range(3):
                                    code = int(255.0 * moments[0] * light[c] / peak + 0.5)
                                    packed |= np.uint32(code) << np.uint32(8 * c)
                                out[goal + (v + 1) * stride + u + 1] = packed
                        at += 1
        peaks[n] = peak
