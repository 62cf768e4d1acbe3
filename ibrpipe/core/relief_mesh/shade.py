"""Colour, light and self-shadow of hits on relief-mapped meshes. Source: policarpo2005, sec. 3.1 and its appendix.

Per pixel: ``ambient c + gate (diffuse c (n . l) + specular (n . h)^shininess)``, c the filtered colour, n the filtered
normal, l toward the light, h halfway between l and the eye; ``gate = min(1, 8 N . l)``, N the polygon's normal, fades
light out where it would come through the polygon (published: N . l). In shadow the diffuse term is multiplied by the
mean of ambient, and the specular one is left out, as published.

Symbols: the frame (3, 3) of :mod:`ibrpipe.core.relief_mesh.hit`; ``lamp``: see the names of its slots.
"""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from ibrpipe.core.jit import helper, kernel
from ibrpipe.core.relief_mesh.hit import ACROSS, BUMP, DEEP, DOWN, MAPPING, RELIEF, SHIFT, search_layers
from ibrpipe.core.relief_mesh.mips import read_footprint
from ibrpipe.core.relief_mesh.search import clip_unit, corners_of, layer_at

#: slots of the lamp: is there one, position (x, y, z from the eye) or direction, 1 = position, ambient, diffuse,
#: specular (three each), shininess, are shadows cast, least depth between a hit and what shades it, probes of
#: filtering, what normals are
LIT, TOWARD, IS_POINT, AMBIENT, DIFFUSE, SPECULAR, SHININESS, SHADOWS, BIAS, PROBES, SLOPES = (
    0, 1, 4, 5, 8, 11, 14, 15, 16, 17, 18,
)  # fmt: skip
LAMPS = 19
#: how fast light fades in above the polygon's horizon
GATE = 8.0


@helper
def _unit(x, y, z):
    length = math.sqrt(x * x + y * y + z * z)
    share = 1.0 / length if length > 0.0 else 0.0
    return x * share, y * share, z * share


@helper
def footprint(frame, world_from_pixel, w, t, out):
    # texture coordinates per pixel of the plane through the hit that is parallel to the polygon -> out (4,)
    fall = frame[6] * w[0] + frame[7] * w[1] + frame[8] * w[2]
    fall = fall if abs(fall) > 1e-300 else 1e-300
    mu = (frame[0] * w[0] + frame[1] * w[1] + frame[2] * w[2]) / fall
    mv = (frame[3] * w[0] + frame[4] * w[1] + frame[5] * w[2]) / fall
    for axis in range(2):
        x, y, z = world_from_pixel[0, axis], world_from_pixel[1, axis], world_from_pixel[2, axis]
        sink = frame[6] * x + frame[7] * y + frame[8] * z
        out[2 * axis] = t * (frame[0] * x + frame[1] * y + frame[2] * z - mu * sink)
        out[2 * axis + 1] = t * (frame[3] * x + frame[4] * y + frame[5] * z - mv * sink)


@helper
def mapped_normal(frame, texel, slopes):
    # unit normal of a texel of the normal map, or of slopes of height per texture coordinate (with their sign turned)
    n = _unit(-frame[6], -frame[7], -frame[8])
    if slopes:
        return _unit(
            texel[0] * frame[0] + texel[1] * frame[3] - frame[6],
            texel[0] * frame[1] + texel[1] * frame[4] - frame[7],
            texel[0] * frame[2] + texel[1] * frame[5] - frame[8],
        )
    # the axes of the texture are the cross products of the frame's other rows
    hand = n[0] * (frame[1] * frame[5] - frame[2] * frame[4])
    hand += n[1] * (frame[2] * frame[3] - frame[0] * frame[5]) + n[2] * (frame[0] * frame[4] - frame[1] * frame[3])
    sign = 1.0 if hand >= 0.0 else -1.0
    a = _unit(
        sign * (frame[4] * n[2] - frame[5] * n[1]),
        sign * (frame[5] * n[0] - frame[3] * n[2]),
        sign * (frame[3] * n[1] - frame[4] * n[0]),
    )
    b = _unit(
        sign * (n[1] * frame[2] - n[2] * frame[1]),
        sign * (n[2] * frame[0] - n[0] * frame[2]),
        sign * (n[0] * frame[1] - n[1] * frame[0]),
    )
    return _unit(
        texel[0] * a[0] + texel[1] * b[0] + texel[2] * n[0],
        texel[0] * a[1] + texel[1] * b[1] + texel[2] * n[1],
        texel[0] * a[2] + texel[1] * b[2] + texel[2] * n[2],
    )


@helper
def back_normal(frame, back, plan, rule, x, y):
    # unit normal of the back layer, out of the object
    i, j = np.int64(math.floor(x)), np.int64(math.floor(y))
    p, q = x - i, y - j
    if plan[3] != 0:
        i, j = i % plan[1], j % plan[0]
    else:
        i, j = min(max(i, 0), plan[1] - 1), min(max(j, 0), plan[0] - 1)
    a, b, c, e = corners_of(back, i, j)
    u = ((b - a) * (1.0 - q) + (e - c) * q) * rule[ACROSS]
    v = ((c - a) * (1.0 - p) + (e - b) * p) * rule[DOWN]
    return _unit(
        frame[6] - u * frame[0] - v * frame[3],
        frame[7] - u * frame[1] - v * frame[4],
        frame[8] - u * frame[2] - v * frame[5],
    )


@helper
def is_shaded(front, back, lows, highs, plan, rule, lamp, frame, position, lx, ly, lz):
    # does the relief lie between a hit and the light, up to the polygon? (lx, ly, lz) unit, toward the light
    rise = frame[6] * lx + frame[7] * ly + frame[8] * lz
    if not rise < 0.0:
        return True
    du = (frame[0] * lx + frame[1] * ly + frame[2] * lz) / rise
    dv = (frame[3] * lx + frame[4] * ly + frame[5] * lz) / rise
    x, y, z = position[0], position[1], position[2]
    dx, dy = du * rule[ACROSS], dv * rule[DOWN]
    x, y = x - z * dx, y - z * dy  # where the light's ray enters
    begin = 0.0
    if plan[3] == 0:
        begin, _ = clip_unit((x - rule[SHIFT]) / rule[ACROSS], du, begin, z)
        begin, _ = clip_unit((y - rule[SHIFT]) / rule[DOWN], dv, begin, z)
    end = z - lamp[BIAS]
    if not begin < end:
        return False
    ray = (x, y, 0.0, dx, dy, 1.0)
    slope = -rise * rule[DEEP]
    if rule[5] > 0.0:
        return search_layers(front, back, lows, highs, plan, rule, ray, begin, end, True, slope) < np.inf
    return search_layers(front, back, lows, highs, plan, rule, ray, begin, z, True, slope) < end


@kernel
def shade_hits(mine, depth, positions, hit_frames, layers, rule, lamp, world_from_pixel, colors, normals, out, alpha):
    # mine (h, w) u8; depth (h, w) f32; positions, hit_frames: see relief_mesh_hit; colors, normals: (texels (M, 4) f32,
    # table) -> out (h, w, 3), alpha (h, w) f32 where mine
    front, back, lows, highs, plan = layers
    color_texels, color_table = colors
    normal_texels, normal_table = normals
    wraps, probes, slopes = plan[3] != 0, np.int64(lamp[PROBES]), lamp[SLOPES] > 0.0
    for y in prange(mine.shape[0]):
        foot, texel, frame, position = np.empty(4), np.empty(4), np.empty(9), np.empty(3)
        for x in range(mine.shape[1]):
            if mine[y, x] == 0:
                continue
            for k in range(9):
                frame[k] = hit_frames[y, x, k]
            for k in range(3):
                position[k] = positions[y, x, k]
            px, py, t = x + 0.5, y + 0.5, float(depth[y, x])
            w = (
                world_from_pixel[0, 0] * px + world_from_pixel[0, 1] * py + world_from_pixel[0, 2],
                world_from_pixel[1, 0] * px + world_from_pixel[1, 1] * py + world_from_pixel[1, 2],
                world_from_pixel[2, 0] * px + world_from_pixel[2, 1] * py + world_from_pixel[2, 2],
            )
            footprint(frame, world_from_pixel, w, t, foot)
            u, v = (position[0] - rule[SHIFT]) / rule[ACROSS], (position[1] - rule[SHIFT]) / rule[DOWN]
            read_footprint(color_texels, color_table, wraps, u, v, foot, probes, texel)
            red, green, blue = texel[0], texel[1], texel[2]
            alpha[y, x] = 1.0
            if lamp[LIT] == 0.0:
                out[y, x, 0], out[y, x, 1], out[y, x, 2] = red, green, blue
                continue
            base = _unit(-frame[6], -frame[7], -frame[8])
            if base[0] * w[0] + base[1] * w[1] + base[2] * w[2] > 0.0:
                base = (-base[0], -base[1], -base[2])
            n = base
            if rule[MAPPING] >= BUMP:
                read_footprint(normal_texels, normal_table, wraps, u, v, foot, probes, texel)
                n = mapped_normal(frame, texel, slopes)
                if back.shape[0] > 0 and rule[MAPPING] == RELIEF:
                    to_front = abs(position[2] - layer_at(front, plan, position[0], position[1]))
                    if abs(layer_at(back, plan, position[0], position[1]) - position[2]) < to_front:
                        n = back_normal(frame, back, plan, rule, position[0], position[1])
            lx, ly, lz = lamp[TOWARD], lamp[TOWARD + 1], lamp[TOWARD + 2]
            if lamp[IS_POINT] > 0.0:
                lx, ly, lz = lx - t * w[0], ly - t * w[1], lz - t * w[2]
            lx, ly, lz = _unit(lx, ly, lz)
            gate = min(1.0, GATE * max(0.0, lx * base[0] + ly * base[1] + lz * base[2]))
            gate = 1.0 if back.shape[0] > 0 else gate
            shine = max(0.0, lx * n[0] + ly * n[1] + lz * n[2])
            e = _unit(-w[0], -w[1], -w[2])
            h = _unit(lx + e[0], ly + e[1], lz + e[2])
            gloss = max(0.0, h[0] * n[0] + h[1] * n[1] + h[2] * n[2]) ** lamp[SHININESS] if shine > 0.0 else 0.0
            shaded = False
            if lamp[SHADOWS] > 0.0 and rule[MAPPING] == RELIEF and shine > 0.0 and gate > 0.0:
                shaded = is_shaded(front, back, lows, highs, plan, rule, lamp, frame, position, lx, ly, lz)
            if shaded:
                shine *= (lamp[AMBIENT] + lamp[AMBIENT + 1] + lamp[AMBIENT + 2]) / 3.0
                gloss = 0.0
            for k in range(3):
                c = red if k == 0 else (green if k == 1 else blue)
                light = lamp[DIFFUSE + k] * c * shine + lamp[SPECULAR + k] * gloss
                out[y, x, k] = lamp[AMBIENT + k] * c + gate * light
