"""A uniform grid of voxels in which free rays meet the patches of layered images. Never wrong, only cautious.

A voxel lists the patches that reach into it, and knows a cone that holds all their normals and the slab, across the
cone's axis, in which they lie. Patches are met from their front alone, so a ray that leaves within 90 degrees of every
normal of the cone meets none of them, and neither does one that stays outside the slab. For each octant of directions
every voxel knows the cube before it that hinders no such ray, and rays step over it at once.

Packed arguments: ``grid`` (frame (4,) f64: least corner, width of a voxel; cells (X, Y, Z) i32: number of a voxel's
record, -1 = nothing reaches it; free (8, X, Y, Z) u8; hulls (C, 6) f64: axis of the cone, sine of its half angle (2 =
all normals), least and greatest distance of the slab along the axis, in voxels from the least corner; starts (C + 1,)
i64 and listed (L, 4) i32: patch, field, column, row of all that reach into a voxel; loose (K, 4) i32: those that every
ray may meet); ``shapes`` (poses (F, 4, 4) f64; corners (P, 4) f32 field depths; masks (P,) u8).
"""

import math

import numpy as np
from numba import prange

from ibrpipe.core.jit import exact_kernel, fused_exact
from ibrpipe.core.ldi.project_heights import OVERLAP
from ibrpipe.core.rays import patch_quadratic

#: patches are taken wider, in voxels, than rays may step too far
MARGIN, STEP = 1e-3, 1e-5
#: widest cube of voxels that is known to be free
WIDEST = 255
BLOCK = 128
#: columns and rows are fewer; room about columns, rows and, by their size, depths
MOST, CLOSE = 1e9, 1e-6
#: least share of a ray's direction along an axis
TILT = 1e-12


@exact_kernel
def measure_free(cells, hulls, out_free):
    """Fill out_free (8, X, Y, Z) u8: width of the cube, of which a voxel is the first, that rays of an octant cross.

    Bit k of the octant: rays run down axis k. Cubes may reach beyond the grid. A voxel hinders no ray of the octant if
    all its normals are of that octant.
    """
    nx, ny, nz = cells.shape
    for octant in prange(8):
        sx, sy, sz = 1 - 2 * (octant & 1), 1 - (octant & 2), 1 - (octant >> 2) * 2
        for x in range(nx - 1, -1, -1) if sx > 0 else range(0, nx, 1):
            for y in range(ny - 1, -1, -1) if sy > 0 else range(0, ny, 1):
                for z in range(nz - 1, -1, -1) if sz > 0 else range(0, nz, 1):
                    voxel = cells[x, y, z]
                    if voxel >= 0:
                        least_along = min(min(sx * hulls[voxel, 0], sy * hulls[voxel, 1]), sz * hulls[voxel, 2])
                        if not least_along > hulls[voxel, 3]:
                            out_free[octant, x, y, z] = 0
                            continue
                    least = WIDEST - 1
                    for k in range(1, 8):
                        u, v, w = x + sx * (k & 1), y + sy * (k >> 1 & 1), z + sz * (k >> 2)
                        if 0 <= u < nx and 0 <= v < ny and 0 <= w < nz:
                            least = min(least, int(out_free[octant, u, v, w]))
                    out_free[octant, x, y, z] = least + 1


@fused_exact
def ray_in_field(poses, f, x, y, z, w):
    # (x, y, z, w): a point (w = 1) or a direction (w = 0) -> homogeneous coordinates of field f
    return (
        poses[f, 0, 0] * x + poses[f, 0, 1] * y + poses[f, 0, 2] * z + poses[f, 0, 3] * w,
        poses[f, 1, 0] * x + poses[f, 1, 1] * y + poses[f, 1, 2] * z + poses[f, 1, 3] * w,
        poses[f, 2, 0] * x + poses[f, 2, 1] * y + poses[f, 2, 2] * z + poses[f, 2, 3] * w,
        poses[f, 3, 0] * x + poses[f, 3, 1] * y + poses[f, 3, 2] * z + poses[f, 3, 3] * w,
    )


@fused_exact
def meet_front(start, direction, column, row, corners, mask, near, far):
    """Nearest t in (0, far] at which a ray meets the front of a patch, inf for none; near: t to count from."""
    # start, direction: homogeneous field coordinates at t = 0 and per t; corners (a, b, c, e); mask: those that count
    A, B, C, u, v, q, du, dv, dq = patch_quadratic(start, direction, column, row, corners, near)
    square = B * B - 4.0 * A * C
    if not square >= 0.0:
        return np.inf
    w = -0.5 * (B + math.copysign(math.sqrt(square), B))
    best = np.inf
    for root in (C / w, w / A):
        if near + root < best and 0.0 < near + root <= far and 2.0 * A * root + B > 0.0:
            wide = q + root * dq
            p, r, slack = u + root * du, v + root * dv, OVERLAP * wide
            if wide > 0.0 and -slack <= p <= wide + slack and -slack <= r <= wide + slack:
                low = p <= 0.5 * wide
                quadrant = (1 if low else 2) if r <= 0.5 * wide else (4 if low else 8)
                if mask & quadrant:
                    best = near + root
    return best


@fused_exact
def reach_in_field(P, Q, near, far):
    """First and last column and row, and least and greatest depth, that a ray reaches between near and far."""
    # P, Q: homogeneous field coordinates at t = 0 and per t
    qa, qb = P[3] + near * Q[3], P[3] + far * Q[3]
    if not (qa > 0.0 and 0.0 < qb < np.inf):
        return -int(MOST), int(MOST), -int(MOST), int(MOST), -np.inf, np.inf
    qa, qb = 1.0 / qa, 1.0 / qb
    ua, va, da = (P[0] + near * Q[0]) * qa, (P[1] + near * Q[1]) * qa, (P[2] + near * Q[2]) * qa
    ub, vb, db = (P[0] + far * Q[0]) * qb, (P[1] + far * Q[1]) * qb, (P[2] + far * Q[2]) * qb
    room = CLOSE * (abs(da) + abs(db))
    left, right = math.floor(max(min(ua, ub), -MOST) - CLOSE), math.floor(min(max(ua, ub), MOST) + CLOSE)
    above, below = math.floor(max(min(va, vb), -MOST) - CLOSE), math.floor(min(max(va, vb), MOST) + CLOSE)
    return int(left), int(right), int(above), int(below), min(da, db) - room, max(da, db) + room


@fused_exact
def meet_listed(origin, direction, near, far, listed, first, last, poses, corners, masks):
    """Nearest (t, patch) in (0, far] of a ray with patches listed[first:last], (inf, -1) for none.

    Only those are sure to be tried that it meets between near and far.
    """
    best, found, field = np.inf, -1, -1
    P, Q = (0.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0)
    left, right, above, below, least, greatest = 0, 0, 0, 0, 0.0, 0.0
    for k in range(first, last):
        if listed[k, 1] != field:
            field = listed[k, 1]
            P = ray_in_field(poses, field, origin[0], origin[1], origin[2], 1.0)
            Q = ray_in_field(poses, field, direction[0], direction[1], direction[2], 0.0)
            left, right, above, below, least, greatest = reach_in_field(P, Q, near, far)
        column, row = listed[k, 2], listed[k, 3]
        if column < left or column > right or row < above or row > below:
            continue
        patch = listed[k, 0]
        a, b = np.float64(corners[patch, 0]), np.float64(corners[patch, 1])
        c, e = np.float64(corners[patch, 2]), np.float64(corners[patch, 3])
        if min(min(a, b), min(c, e)) > greatest or max(max(a, b), max(c, e)) < least:
            continue
        t = meet_front(P, Q, float(column), float(row), (a, b, c, e), masks[patch], near, far)
        if t < best or (t == best and t < np.inf and patch < found):
            best, found = t, patch
    return best, found


@fused_exact
def tilt(direction, length):
    """A part of a direction of some length, but not 0."""
    return direction if abs(direction) > TILT * length else math.copysign(TILT * length, direction)


@fused_exact
def enter_voxels(at, per, size, near, far):
    """Cut [near, far] to where one axis of the grid holds the ray; per: t for a voxel."""
    one, other = -at * per, (size - at) * per
    return max(near, min(one, other)), min(far, max(one, other))


@fused_exact
def follow_rays(rays, first, last, grid, shapes, out_t, out_ids):
    """Set out_t and out_ids to what rays[first:last] meet: t in lengths of the direction, patch; inf, -1 = nothing."""
    # rays (N, 6) f64: origin, direction. Many rays in one call: arrays in tuples are counted at every call
    frame, cells, free, hulls, starts, listed, loose = grid
    poses, corners, masks = shapes
    nx, ny, nz = cells.shape
    scale = 1.0 / frame[3]
    for i in range(first, last):
        origin, direction = (rays[i, 0], rays[i, 1], rays[i, 2]), (rays[i, 3], rays[i, 4], rays[i, 5])
        best, found = np.inf, -1
        if len(loose) > 0:
            best, found = meet_listed(
                origin, direction, 0.0, np.inf, loose, np.int64(0), len(loose), poses, corners, masks
            )
        dx, dy, dz = direction[0] * scale, direction[1] * scale, direction[2] * scale
        length = math.sqrt(dx * dx + dy * dy + dz * dz)
        x, y, z = (origin[0] - frame[0]) * scale, (origin[1] - frame[1]) * scale, (origin[2] - frame[2]) * scale
        dx, dy, dz = tilt(dx, length), tilt(dy, length), tilt(dz, length)
        per_x, per_y, per_z, step, room = 1.0 / dx, 1.0 / dy, 1.0 / dz, STEP / length, MARGIN / length
        t, end = enter_voxels(x, per_x, nx, 0.0, best)
        t, end = enter_voxels(y, per_y, ny, t, end)
        t, end = enter_voxels(z, per_z, nz, t, end)
        octant = (1 if dx < 0.0 else 0) | (2 if dy < 0.0 else 0) | (4 if dz < 0.0 else 0)
        # a ray leaves a cube from (u, v, w) on through u + back + wide * ahead, ...
        back_x, back_y, back_z = (1.0 if dx < 0.0 else 0.0), (1.0 if dy < 0.0 else 0.0), (1.0 if dz < 0.0 else 0.0)
        ahead_x, ahead_y, ahead_z = 1.0 - 2.0 * back_x, 1.0 - 2.0 * back_y, 1.0 - 2.0 * back_z
        back_x, back_y, back_z = back_x - x, back_y - y, back_z - z
        while t <= end:
            u = min(max(int(x + t * dx), 0), nx - 1)
            v = min(max(int(y + t * dy), 0), ny - 1)
            w = min(max(int(z + t * dz), 0), nz - 1)
            cube = free[octant, u, v, w]
            wide = max(float(cube), 1.0)
            leave = min((u + (back_x + wide * ahead_x)) * per_x, (v + (back_y + wide * ahead_y)) * per_y)
            leave = max(t, min(min(leave, (w + (back_z + wide * ahead_z)) * per_z), end))
            if cube == 0:
                voxel = cells[u, v, w]
                hx, hy, hz = hulls[voxel, 0], hulls[voxel, 1], hulls[voxel, 2]
                along = dx * hx + dy * hy + dz * hz
                if not along > hulls[voxel, 3] * length:
                    near, far = t - room, leave + room
                    if along != 0.0:
                        height, per = x * hx + y * hy + z * hz, 1.0 / along
                        one, other = (hulls[voxel, 4] - height) * per, (hulls[voxel, 5] - height) * per
                        near, far = max(near, min(one, other)), min(far, max(one, other))
                    if near <= far:
                        hit, patch = meet_listed(
                            origin, direction, near, min(far, best), listed, starts[voxel], starts[voxel + 1], poses,
                            corners, masks,
                        )  # fmt: skip
                        if hit < best or (hit == best and 0 <= patch < found):
                            best, found = hit, patch
                            break
            t = leave + step
        out_t[i], out_ids[i] = best, found


@exact_kernel
def cast_rays(rays, grid, shapes, out_t, out_ids):
    """Fill out_t (N,) f64, in lengths of the direction, and out_ids (N,) i64 with what rays meet; inf, -1 = nothing."""
    # rays (N, 6) f64 origin, direction
    for block in prange((len(rays) + BLOCK - 1) // BLOCK):
        last = min(block * BLOCK + BLOCK, len(rays))
        follow_rays(rays, block * BLOCK, last, grid, shapes, out_t, out_ids)
