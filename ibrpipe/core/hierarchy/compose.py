"""Slices of a part made from the slices of its copies, without its polygons. Source: max1999, sec. 2 (upper levels).

Symbols as in `prefilter`: a, b, d: axes of a view, d towards the viewer; R texels and K slabs across the part's sphere;
q x q places a texel. All slices of all copies are laid over each other from front to back at every place of every
slab: one stops its coverage of what those before it let through.
"""

from __future__ import annotations

import numpy as np
from numba import prange

from ibrpipe.core.hierarchy.prefilter import mean_texel, unpack_texel
from ibrpipe.core.hierarchy.traverse import determinant, octahedral_cell, solve, stretch
from ibrpipe.core.jit import helper, kernel


@helper
def coarsest(resolutions, need):
    # index of the coarsest resolution of at least `need` texels, else of the finest
    level = 0
    while level < len(resolutions) - 1 and resolutions[level] < need:
        level += 1
    return level


@helper
def plane_in_view(pose, sphere, child, axes, view, step, half, height, out):
    # a child's plane at `height`, seen along a view of its parent -> out (7,): places (x, y) over its texels (u, v, 1)
    # row by row, then its height along d; step: child's unit per texel; half: R / 2 of the child; view (3, 3): a, b, d
    # over the parent's unit per place
    point = np.empty(3)
    for i in range(3):
        point[i] = child[i] - half * step * (axes[0, i] + axes[1, i]) + height * axes[2, i]
    for row in range(3):
        x, y, z = view[row, 0], view[row, 1], view[row, 2]
        mx = x * pose[0] + y * pose[4] + z * pose[8]
        my = x * pose[1] + y * pose[5] + z * pose[9]
        mz = x * pose[2] + y * pose[6] + z * pose[10]
        along = x * (pose[3] - sphere[0]) + y * (pose[7] - sphere[1]) + z * (pose[11] - sphere[2])
        origin = mx * point[0] + my * point[1] + mz * point[2] + along
        if row < 2:
            out[3 * row] = step * (mx * axes[0, 0] + my * axes[0, 1] + mz * axes[0, 2])
            out[3 * row + 1] = step * (mx * axes[1, 0] + my * axes[1, 1] + mz * axes[1, 2])
            out[3 * row + 2] = origin
        else:
            middle = half * step
            across = mx * (axes[0, 0] + axes[1, 0]) + my * (axes[0, 1] + axes[1, 1]) + mz * (axes[0, 2] + axes[1, 2])
            out[6] = origin + middle * across


@helper
def normal_turn(pose, out):
    # -> out (3, 3): inverse transpose of a pose, of length 1 for turns with one scale
    det, size = determinant(pose), stretch(pose)
    for i in range(3):
        x, y, z = solve(pose, det, 1.0 if i == 0 else 0.0, 1.0 if i == 1 else 0.0, 1.0 if i == 2 else 0.0)
        out[i, 0], out[i, 1], out[i, 2] = x * size, y * size, z * size


@helper
def turn_moments(t, mix):
    # mix (12,): sums of coverage, albedo (3), n (3), xx, yy, xy, xz, yz; its normals are turned by t (3, 3) and keep
    # their mean square length
    nx, ny, nz = mix[4], mix[5], mix[6]
    xx, yy, xy, xz, yz = mix[7], mix[8], mix[9], mix[10], mix[11]
    zz = max(mix[0] - xx - yy, 0.0)
    trace = 0.0
    for i in range(3):
        x, y, z = t[i, 0], t[i, 1], t[i, 2]
        trace += xx * x * x + yy * y * y + zz * z * z + 2.0 * (xy * x * y + xz * x * z + yz * y * z)
    share = mix[0] / max(trace, 1e-300)
    root = np.sqrt(share)
    for i in range(3):
        mix[4 + i] = root * (t[i, 0] * nx + t[i, 1] * ny + t[i, 2] * nz)
    for m in range(5):
        i, j = (m, m) if m < 2 else ((0, m - 1) if m < 4 else (1, 2))
        ax = xx * t[j, 0] + xy * t[j, 1] + xz * t[j, 2]
        ay = xy * t[j, 0] + yy * t[j, 1] + yz * t[j, 2]
        az = xz * t[j, 0] + yz * t[j, 1] + zz * t[j, 2]
        mix[7 + m] = share * (t[i, 0] * ax + t[i, 1] * ay + t[i, 2] * az)


@helper
def mix_texels(texels, slab, u, v, texel, mix):
    # bilinear mean of a slab's texels around (u, v), 0 beyond them -> mix (12,); texel (12,) is working memory
    mix[:] = 0.0
    left, top = int(np.floor(u - 0.5)), int(np.floor(v - 0.5))
    right, below = u - 0.5 - left, v - 0.5 - top
    for corner in range(4):
        i, j = left + (corner & 1) - slab[0], top + (corner >> 1) - slab[1]
        weight = (right if corner & 1 else 1.0 - right) * (below if corner >> 1 else 1.0 - below)
        if 0 <= i < slab[2] and 0 <= j < slab[3] and weight > 0.0:
            texel[:] = 0.0
            unpack_texel(texels, slab[4] + j * slab[2] + i, texel)
            for c in range(12):
                mix[c] += weight * texel[c]


@helper
def lay_slice(plane, texels, slab, turn, clear, sums, rays, work):
    # one slice of a copy over a slab of its parent: clear (S, S): what places still let through; sums (R, R, 12);
    # turn (3, 3) of its normals -> places that it covers of what was clear
    mix, texel = work
    gained = 0.0
    area = plane[0] * plane[4] - plane[1] * plane[3]
    if area == 0.0:
        return gained
    low_x, high_x, low_y, high_y = np.inf, -np.inf, np.inf, -np.inf
    for corner in range(4):
        u = slab[0] - 0.5 + (corner & 1) * (slab[2] + 1.0)
        v = slab[1] - 0.5 + (corner >> 1) * (slab[3] + 1.0)
        x, y = plane[0] * u + plane[1] * v + plane[2], plane[3] * u + plane[4] * v + plane[5]
        low_x, high_x, low_y, high_y = min(low_x, x), max(high_x, x), min(low_y, y), max(high_y, y)
    last = len(clear)
    for y in range(max(int(np.floor(low_y)), 0), min(int(np.ceil(high_y)), last)):
        for x in range(max(int(np.floor(low_x)), 0), min(int(np.ceil(high_x)), last)):
            px, py = x + 0.5 - plane[2], y + 0.5 - plane[5]
            u, v = (px * plane[4] - py * plane[1]) / area, (py * plane[0] - px * plane[3]) / area
            mix_texels(texels, slab, u, v, texel, mix)
            if mix[0] > 0.0:
                through = clear[y, x]
                clear[y, x] = through * (1.0 - mix[0])
                gained += through * mix[0]
                turn_moments(turn, mix)
                for c in range(12):
                    sums[y // rays, x // rays, c] += through * mix[c]
    return gained


@kernel
def compose(copies, sphere, axes, lookup, library, fineness, rays, out, heights):
    # copies: parts (C,) i64, matrices (C, 12) f64; sphere (4,) f64 of the parent; axes (D, 3, 3) f64 of views, the same
    # for all; lookup: nearest view; library: spheres (P, 4), resolutions (L,), stacks (T + 1,), slabs (S, 7) i64,
    # heights (S, 2), texels (N, 12) u8; fineness: texels of a copy per texel of the parent; rays = q
    # -> out (D, K, R, R, 12) u8, heights (D, K, 2) f32 as `prefilter` makes them
    parts, matrices = copies
    spheres, resolutions, stacks, slabs, levels, texels = library
    count, resolution = out.shape[1], out.shape[2]
    half, radius = 0.5 * resolution * rays, sphere[3]
    for direction in prange(len(axes)):
        view = np.empty((3, 3))
        for row in range(3):
            for c in range(3):
                view[row, c] = axes[direction, row, c] * (half / radius)
        most = 0
        firsts, views, chosen = (
            np.empty(len(parts), np.int64), np.empty(len(parts), np.int64), np.empty(len(parts), np.int64),
        )  # fmt: skip
        for n in range(len(parts)):
            det = determinant(matrices[n])
            d = axes[direction, 2]
            firsts[n] = -1
            if det != 0.0:
                x, y, z = solve(matrices[n], det, d[0], d[1], d[2])
                cell = octahedral_cell(x, y, z, lookup.shape[0])
                views[n] = lookup[cell // lookup.shape[0], cell % lookup.shape[0]]
                need = fineness * stretch(matrices[n]) * spheres[parts[n], 3] / radius * resolution
                chosen[n] = coarsest(resolutions, need)
                firsts[n] = (parts[n] * len(resolutions) + chosen[n]) * len(axes) + views[n]
                most += stacks[firsts[n] + 1] - stacks[firsts[n]]
        planes, owners, places = np.empty((most, 7)), np.empty((most, 2), np.int64), np.empty(most)
        m = 0
        for n in range(len(parts)):
            if firsts[n] >= 0:
                across = 0.5 * resolutions[chosen[n]]
                child = spheres[parts[n]]
                for s in range(stacks[firsts[n]], stacks[firsts[n] + 1]):
                    step, plane = child[3] / across, planes[m]
                    plane_in_view(matrices[n], sphere, child, axes[views[n]], view, step, across, levels[s, 1], plane)
                    places[m], owners[m, 0], owners[m, 1] = -planes[m, 6], n, s
                    for c in range(2):
                        planes[m, 2 + 3 * c] += half
                    m += 1
        order = np.argsort(places, kind="mergesort")
        sums, clear = np.zeros((count, resolution, resolution, 12)), np.ones((count, 2 * int(half), 2 * int(half)))
        totals, weights = np.zeros(count), np.zeros(count)
        work, turn = (np.empty(12), np.empty(12)), np.empty((3, 3))
        for m in order:
            n, s = owners[m, 0], owners[m, 1]
            k = min(max(int((half + places[m]) * count / (2.0 * half)), 0), count - 1)
            normal_turn(matrices[n], turn)
            gained = lay_slice(planes[m], texels, slabs[s], turn, clear[k], sums[k], rays, work)
            totals[k] -= gained * places[m] * radius / half
            weights[k] += gained
        samples = np.empty(11)
        for k in range(count):
            heights[direction, k, :] = totals[k] / weights[k] if weights[k] > 0.0 else np.nan
            for v in range(resolution):
                for u in range(resolution):
                    if 255.0 * sums[k, v, u, 0] >= 0.5 * rays * rays:
                        for c in range(11):
                            samples[c] = sums[k, v, u, 1 + c]
                        mean_texel(samples, sums[k, v, u, 0], rays * rays, 1.0, out[direction, k, v, u])
