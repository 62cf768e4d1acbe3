"""The zero surface of signed distances on sparse blocks, as a mesh. Source: gibson1998 (surface nets).

One vertex for every cell of 2 x 2 x 2 known voxels whose signs differ, at the mean of the crossings of the cell's
edges; one quad, cut in two triangles, for every voxel edge whose ends differ in sign and whose cells all have a vertex.
Where a voxel is unknown (NaN) the surface has a hole. Blocks are laid out as in `volume`; ``grid`` finds them.
"""

import numpy as np
from numba import prange

from ibrpipe.core.jit import helper, kernel, serial

SIDE = 8


@helper
def entry(grid, i, j, k):
    """Return block and number in it of voxel (i, j, k), block -1 where there is none."""
    a, b, c = i // SIDE, j // SIDE, k // SIDE
    if i < 0 or j < 0 or k < 0 or a >= grid.shape[0] or b >= grid.shape[1] or c >= grid.shape[2]:
        return -1, 0
    return grid[a, b, c], 64 * (i % SIDE) + 8 * (j % SIDE) + k % SIDE


@helper
def value_at(grid, value, i, j, k):
    """Return the distance at voxel (i, j, k), NaN where unknown."""
    block, number = entry(grid, i, j, k)
    return np.float32(np.nan) if block < 0 else value[block, number]


@kernel
def mark_cells(corners, grid, value, out_marked):
    """Find the cells that the surface passes."""
    # corners (B, 3) i32; grid (GX, GY, GZ) i32, block or -1; value (B, 512) f32, NaN = unknown; out_marked (B, 512) u8
    for b in prange(corners.shape[0]):
        for v in range(SIDE * SIDE * SIDE):
            i, j, k = corners[b, 0] + v // 64, corners[b, 1] + v // 8 % 8, corners[b, 2] + v % 8
            below, known = 0, True
            for c in range(8):
                d = value_at(grid, value, i + c // 4, j + c // 2 % 2, k + c % 2)
                if np.isnan(d):
                    known = False
                    break
                below += 1 if d < 0.0 else 0
            out_marked[b, v] = 1 if known and below > 0 and below < 8 else 0


@kernel
def place_vertices(corners, grid, value, vertex, out_position):
    """Put every marked cell's vertex at the mean of its edges' crossings."""
    # vertex (B, 512) i32, number of the cell's vertex or -1; out_position (V, 3) f64, in voxels
    for b in prange(corners.shape[0]):
        for v in range(SIDE * SIDE * SIDE):
            number = vertex[b, v]
            if number < 0:
                continue
            i, j, k = corners[b, 0] + v // 64, corners[b, 1] + v // 8 % 8, corners[b, 2] + v % 8
            x, y, z, crossings = 0.0, 0.0, 0.0, 0
            for c in range(8):
                ci, cj, ck = c // 4, c // 2 % 2, c % 2
                near = value_at(grid, value, i + ci, j + cj, k + ck)
                for axis in range(3):
                    ei, ej, ek = ci + (axis == 0), cj + (axis == 1), ck + (axis == 2)
                    if ei > 1 or ej > 1 or ek > 1:
                        continue
                    far = value_at(grid, value, i + ei, j + ej, k + ek)
                    if (near < 0.0) == (far < 0.0):
                        continue
                    t = near / (near - far)
                    x += ci + t * (axis == 0)
                    y += cj + t * (axis == 1)
                    z += ck + t * (axis == 2)
                    crossings += 1
            out_position[number, 0] = i + x / crossings
            out_position[number, 1] = j + y / crossings
            out_position[number, 2] = k + z / crossings


@helper
def cell_vertex(grid, vertex, i, j, k):
    """Return the number of the vertex of cell (i, j, k), -1 = none."""
    block, number = entry(grid, i, j, k)
    return -1 if block < 0 else vertex[block, number]


@serial
def join_quads(corners, grid, value, vertex, out_faces):
    """Join the vertices around every crossed voxel edge; returns the number of faces, written as far as they fit."""
    # out_faces (F, 3) i32, counter-clockwise seen from the positive side
    count = 0
    for b in range(corners.shape[0]):
        for v in range(SIDE * SIDE * SIDE):
            i, j, k = corners[b, 0] + v // 64, corners[b, 1] + v // 8 % 8, corners[b, 2] + v % 8
            near = value[b, v]
            if np.isnan(near):
                continue
            for axis in range(3):
                far = value_at(grid, value, i + (axis == 0), j + (axis == 1), k + (axis == 2))
                if np.isnan(far) or (near < 0.0) == (far < 0.0):
                    continue
                ui, uj, uk = axis == 2, axis == 0, axis == 1  # the two other axes, in right-handed order
                wi, wj, wk = axis == 1, axis == 2, axis == 0
                p = cell_vertex(grid, vertex, i, j, k)
                q = cell_vertex(grid, vertex, i - ui, j - uj, k - uk)
                r = cell_vertex(grid, vertex, i - ui - wi, j - uj - wj, k - uk - wk)
                s = cell_vertex(grid, vertex, i - wi, j - wj, k - wk)
                if p < 0 or q < 0 or r < 0 or s < 0:
                    continue
                if count + 2 <= out_faces.shape[0]:
                    if near < 0.0:
                        put(out_faces, count, p, q, r)
                        put(out_faces, count + 1, p, r, s)
                    else:
                        put(out_faces, count, p, r, q)
                        put(out_faces, count + 1, p, s, r)
                count += 2
    return count


@helper
def put(out_faces, row, a, b, c):
    """Write one face."""
    out_faces[row, 0], out_faces[row, 1], out_faces[row, 2] = a, b, c
