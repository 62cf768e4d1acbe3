"""A coarse grid of voxels that says which sheets of a surface a free ray may meet. Never wrong, only cautious.

A voxel names the sheets whose patches reach into it, and a cone that holds all normals of these patches. Patches are
met from their front alone, so a ray that leaves within 90 degrees of every normal of the cone meets none of them. For
each octant of directions every voxel knows the cube before it that hinders no such ray, and rays step over it at once.

A patch lies in the hull of its four corners, and its normals in that of the normals there, in either kind of frame.

``pose`` (4, 4), ``leaves``: see :mod:`ibrpipe.core.reflection.geometry` and renderers.search.quadtree.Sheet;
``frame`` (4,) f64: least corner of the grid, width of a voxel; ``cells`` (X, Y, Z) i32: number of the voxel's record,
-1 = nothing reaches it; ``bits`` (C,) i64; ``cones`` (C, 4) f64: axis, sine of the half angle (2 = all normals).
"""

import math

import numpy as np
from numba import prange

from ibrpipe.core.jit import exact_kernel, fused_exact, serial

#: patches are taken wider, in voxels, than rays may step too far
MARGIN, STEP = 1e-3, 1e-5
#: added to the sine of a cone's half angle
SLACK = 1e-5
#: widest cube of voxels that is known to be free
WIDEST = 255
BLOCK = 128


@serial
def outline_patch(pose, back, column, row, corners, out_points, out_normals):
    """Fill corners in the world (4, 3) and unit normals there (4, 3), both f64; False where a corner has none."""
    # back: inverse of pose; corners (4,) f32 field depths
    a, b, c, e = float(corners[0]), float(corners[1]), float(corners[2]), float(corners[3])
    for k in range(4):
        p, q, d = k & 1, k >> 1, float(corners[k])
        u, v = column + p, row + q
        weight = back[3, 0] * u + back[3, 1] * v + back[3, 2] * d + back[3, 3]
        if not 0.0 < weight < np.inf:
            return False
        rise_u, rise_v = (e - c if q else b - a), (e - b if p else c - a)
        rest = rise_u * u + rise_v * v - d
        length = 0.0
        for axis in range(3):
            out_points[k, axis] = (back[axis, 0] * u + back[axis, 1] * v + back[axis, 2] * d + back[axis, 3]) / weight
            normal = rise_u * pose[0, axis] + rise_v * pose[1, axis] - pose[2, axis] + -rest * pose[3, axis]
            out_normals[k, axis] = normal
            length += normal * normal
        if not 0.0 < length < np.inf:
            return False
        for axis in range(3):
            out_normals[k, axis] /= math.sqrt(length)
    return True


@serial
def bound_sheet(pose, back, columns, leaves, out_bounds):
    """Widen out_bounds (2, 3) f64 by a sheet's patches; return how many have no position."""
    points, normals, lost = np.empty((4, 3)), np.empty((4, 3)), 0
    for cell in range(len(leaves[1])):
        patch = leaves[1][cell]
        if patch < 0:
            continue
        if not outline_patch(pose, back, cell % columns, cell // columns, leaves[2][patch], points, normals):
            lost += 1
            continue
        for k in range(4):
            for axis in range(3):
                out_bounds[0, axis] = min(out_bounds[0, axis], points[k, axis])
                out_bounds[1, axis] = max(out_bounds[1, axis], points[k, axis])
    return lost


@serial
def reach_of(points, frame, size, out_reach):
    """Fill out_reach (3, 2) i64: first and last (exclusive) voxel that a patch may reach."""
    for axis in range(3):
        least = min(min(points[0, axis], points[1, axis]), min(points[2, axis], points[3, axis]))
        greatest = max(max(points[0, axis], points[1, axis]), max(points[2, axis], points[3, axis]))
        first = math.floor((least - frame[axis]) / frame[3] - MARGIN)
        last = math.floor((greatest - frame[axis]) / frame[3] + MARGIN)
        out_reach[axis, 0] = min(max(first, 0), size[axis] - 1)
        out_reach[axis, 1] = min(max(last, 0), size[axis] - 1) + 1


@serial
def mark_sheet(pose, back, columns, leaves, frame, bit, cells, count, out_bits, out_normals):
    """Number the voxels that a sheet reaches from `count` on, and add its bit and normals; return the new count."""
    # cells: -1 = not yet numbered; out_bits (C,) i64; out_normals (C, 3) f64; what lies beyond C is counted alone
    points, normals, reach = np.empty((4, 3)), np.empty((4, 3)), np.empty((3, 2), np.int64)
    for cell in range(len(leaves[1])):
        patch = leaves[1][cell]
        if patch < 0 or not outline_patch(
            pose, back, cell % columns, cell // columns, leaves[2][patch], points, normals
        ):
            continue
        reach_of(points, frame, cells.shape, reach)
        for x in range(reach[0, 0], reach[0, 1]):
            for y in range(reach[1, 0], reach[1, 1]):
                for z in range(reach[2, 0], reach[2, 1]):
                    if cells[x, y, z] < 0:
                        cells[x, y, z] = count
                        count += 1
                    voxel = cells[x, y, z]
                    if voxel >= len(out_bits):
                        continue
                    out_bits[voxel] |= bit
                    for axis in range(3):
                        for k in range(4):
                            out_normals[voxel, axis] += normals[k, axis]
    return count


@serial
def open_cones(pose, back, columns, leaves, frame, cells, axes, out_cosines):
    """Lower out_cosines (C,) f64 to the cosine of the widest angle between a sheet's normals and axes (C, 3) f64."""
    points, normals, reach = np.empty((4, 3)), np.empty((4, 3)), np.empty((3, 2), np.int64)
    for cell in range(len(leaves[1])):
        patch = leaves[1][cell]
        if patch < 0 or not outline_patch(
            pose, back, cell % columns, cell // columns, leaves[2][patch], points, normals
        ):
            continue
        reach_of(points, frame, cells.shape, reach)
        for x in range(reach[0, 0], reach[0, 1]):
            for y in range(reach[1, 0], reach[1, 1]):
                for z in range(reach[2, 0], reach[2, 1]):
                    voxel = cells[x, y, z]
                    for k in range(4):
                        cosine = 0.0
                        for axis in range(3):
                            cosine += normals[k, axis] * axes[voxel, axis]
                        out_cosines[voxel] = min(out_cosines[voxel], cosine)


@exact_kernel
def measure_free(cells, cones, out_free):
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
                        cone = cones[voxel]
                        if not min(min(sx * cone[0], sy * cone[1]), sz * cone[2]) > cone[3]:
                            out_free[octant, x, y, z] = 0
                            continue
                    least = WIDEST - 1
                    for k in range(1, 8):
                        u, v, w = x + sx * (k & 1), y + sy * (k >> 1 & 1), z + sz * (k >> 2)
                        if 0 <= u < nx and 0 <= v < ny and 0 <= w < nz:
                            least = min(least, int(out_free[octant, u, v, w]))
                    out_free[octant, x, y, z] = least + 1


@fused_exact
def enter_voxels(at, direction, size, near, far):
    """Cut [near, far] to where one axis of the grid holds the ray."""
    if direction == 0.0:
        return (near, far) if 0.0 <= at <= size else (near, -np.inf)
    one, other = -at / direction, (size - at) / direction
    return max(near, min(one, other)), min(far, max(one, other))


@fused_exact
def sheets_of_ray(origin, direction, grid, always):
    """Sheets, as bits, that a ray may meet; origin, direction (3,) world, grid (frame, cells, free, bits, cones)."""
    frame, cells, free, bits, cones = grid
    nx, ny, nz = cells.shape
    found, scale = always, 1.0 / frame[3]
    length = 1.0 / math.sqrt(direction[0] * direction[0] + direction[1] * direction[1] + direction[2] * direction[2])
    dx, dy, dz = direction[0] * length, direction[1] * length, direction[2] * length
    x, y, z = (origin[0] - frame[0]) * scale, (origin[1] - frame[1]) * scale, (origin[2] - frame[2]) * scale
    t, end = enter_voxels(x, dx, nx, 0.0, np.inf)
    t, end = enter_voxels(y, dy, ny, t, end)
    t, end = enter_voxels(z, dz, nz, t, end)
    octant = (1 if dx < 0.0 else 0) | (2 if dy < 0.0 else 0) | (4 if dz < 0.0 else 0)
    per_x, per_y, per_z = 1.0 / dx, 1.0 / dy, 1.0 / dz
    while t <= end:
        u = min(max(int(x + t * dx), 0), nx - 1)
        v = min(max(int(y + t * dy), 0), ny - 1)
        w = min(max(int(z + t * dz), 0), nz - 1)
        wide = int(free[octant, u, v, w])
        if wide == 0:
            cone = cones[cells[u, v, w]]
            if not dx * cone[0] + dy * cone[1] + dz * cone[2] > cone[3]:
                found |= bits[cells[u, v, w]]
            wide = 1
        leave = end
        if dx != 0.0:
            leave = min(leave, ((u + wide if dx > 0.0 else u + 1 - wide) - x) * per_x)
        if dy != 0.0:
            leave = min(leave, ((v + wide if dy > 0.0 else v + 1 - wide) - y) * per_y)
        if dz != 0.0:
            leave = min(leave, ((w + wide if dz > 0.0 else w + 1 - wide) - z) * per_z)
        t = max(t, leave) + STEP
    return found


@exact_kernel
def find_sheets(rays, grid, always, out_bits):
    """Fill out_bits (N,) i64: the sheets that rays (N, 6) f64, origin and direction, may meet."""
    for block in prange((len(rays) + BLOCK - 1) // BLOCK):
        for i in range(block * BLOCK, min(block * BLOCK + BLOCK, len(rays))):
            origin, direction = (rays[i, 0], rays[i, 1], rays[i, 2]), (rays[i, 3], rays[i, 4], rays[i, 5])
            out_bits[i] = sheets_of_ray(origin, direction, grid, always)
