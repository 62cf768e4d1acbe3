"""Directions as positions in an octahedral table, and back. Source: cigolle2014, sec. 2; the wrap across edges is ours.

A table of n x n cells covers the unit square of the octahedral map; cell (0, 0)'s centre is at (0.5, 0.5) / n. It is
read bilinearly from its *padded* form (n + 2, n + 2), whose border repeats the cells that lie across the folded edges:
beyond cell (i, 0) lies (n - 1 - i, 0), and all four corners are the one direction -z.
"""

import numpy as np

from ibrpipe.core.jit import fused_exact

#: of float32, so that positions are computed in the precision of the direction
NONE, HALF, ONE = np.float32(0.0), np.float32(0.5), np.float32(1.0)


@fused_exact
def octahedral_position(x, y, z, size):
    # direction, any length but 0 -> (u, v) in [0.5, size + 0.5]: padded cell (i, j)'s centre is at (i, j); no branches
    scale, n = ONE / (abs(x) + abs(y) + abs(z)), np.float32(size)
    u, v = x * scale, y * scale
    du, dv = ONE - abs(v), ONE - abs(u)
    du, dv = (du if u >= NONE else -du), (dv if v >= NONE else -dv)
    u, v = (u if z >= NONE else du), (v if z >= NONE else dv)
    return (u + ONE) * HALF * n + HALF, (v + ONE) * HALF * n + HALF


@fused_exact
def table_cell(x, y, z, size):
    # direction -> (row and column of the nearer corner in the padded table, as one number; position in the cell)
    u, v = octahedral_position(x, y, z, size)
    i, j, most = np.int32(u), np.int32(v), np.int32(size)
    i, j = (i if i < most else most), (j if j < most else most)
    return np.int32(j * (most + 2) + i), u - np.float32(i), v - np.float32(j)


def cell_directions(size):
    """(size, size, 3) float64 unit directions of the centres of all cells; rows are v, columns u."""
    u, v = np.meshgrid((np.arange(size) + 0.5) * 2 / size - 1, (np.arange(size) + 0.5) * 2 / size - 1)
    z = 1 - abs(u) - abs(v)
    x = np.where(z < 0, np.copysign(1 - abs(v), u), u)
    y = np.where(z < 0, np.copysign(1 - abs(u), v), v)
    found = np.stack([x, y, z], axis=-1)
    return found / np.linalg.norm(found, axis=-1, keepdims=True)


def padded_cells(size):
    """(size + 2, size + 2) int64: number of the cell that every cell of the padded table shows."""
    inner = np.arange(size * size).reshape(size, size)
    out = np.empty((size + 2, size + 2), np.int64)
    out[1:-1, 1:-1] = inner
    out[0, 1:-1], out[-1, 1:-1] = inner[0, ::-1], inner[-1, ::-1]
    out[1:-1, 0], out[1:-1, -1] = inner[::-1, 0], inner[::-1, -1]
    out[0, 0], out[0, -1], out[-1, 0], out[-1, -1] = inner[-1, -1], inner[-1, 0], inner[0, -1], inner[0, 0]
    return out


def pad(tables):
    """Pad tables (L, n, n, C) by the cells across their edges: (L, n + 2, n + 2, C)."""
    size = tables.shape[1]
    return np.ascontiguousarray(tables.reshape(len(tables), size * size, tables.shape[3])[:, padded_cells(size)])


def fold(padded):
    """Sum a padded table (L, n + 2, n + 2, C) into the cells (L, n, n, C) that it shows: the transpose of `pad`."""
    size = padded.shape[1] - 2
    cells = padded_cells(size)
    out = padded[:, 1:-1, 1:-1].reshape(len(padded), size * size, padded.shape[3]).copy()
    for border in (np.s_[0, :], np.s_[-1, :], np.s_[1:-1, 0], np.s_[1:-1, -1]):
        np.add.at(out, (slice(None), cells[border]), padded[(slice(None), *border)])
    return out.reshape(len(padded), size, size, padded.shape[3])
