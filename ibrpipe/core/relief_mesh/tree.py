"""A tree of boxes over the prisms of a shell: sorted once along a curve, fitted anew to every set of vertices.

The curve is Morton's (morton1966).
The tree is complete: node k has the children 2k + 1 and 2k + 2, and leaf number l holds the prisms ``4 l .. 4 l + 3``
of the sorted order. So vertices may move: only the boxes change.
"""

from __future__ import annotations

import numpy as np
from numba import prange

from ibrpipe.core.jit import kernel

#: prisms of a leaf
LEAF = 4


def sort_faces(vertices: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Return the order (F,) int64 of the faces along a Morton curve of 20 bits a side through their middles."""
    middles = vertices[corners].mean(axis=1)
    low, size = middles.min(axis=0), float(np.ptp(middles, axis=0).max()) or 1.0
    cells = ((middles - low) / size * (2**20 - 1)).astype(np.uint64)
    code = np.zeros(len(middles), np.uint64)
    for bit in range(20):
        for axis in range(3):
            code |= ((cells[:, axis] >> np.uint64(bit)) & np.uint64(1)) << np.uint64(3 * bit + axis)
    return np.argsort(code, kind="stable").astype(np.int64)


def count_leaves(faces: int) -> int:
    """Return how many leaves the tree over `faces` prisms has, a power of two."""
    return 1 << max(0, (-(-faces // LEAF) - 1).bit_length())


@kernel
def fit_leaves(vertices, normals, corners, deep, order, leaves, boxes):
    # prisms from the polygons (z = 0) down to `deep` below them (z = 1) -> boxes (2 leaves - 1, 6) f64, the leaves'
    # part
    for leaf in prange(leaves):
        node = leaves - 1 + leaf
        for axis in range(3):
            low, high = np.inf, -np.inf
            for at in range(LEAF * leaf, min(LEAF * leaf + LEAF, len(order))):
                for c in range(3):
                    v = corners[order[at], c]
                    top = vertices[v, axis]
                    below = top - deep * normals[v, axis]
                    low, high = min(low, min(top, below)), max(high, max(top, below))
            pad = 1e-9 * max(abs(low), abs(high)) if low <= high else 0.0
            boxes[node, axis], boxes[node, 3 + axis] = low - pad, high + pad


@kernel
def fit_level(first, count, boxes):
    # boxes of the nodes first .. first + count - 1 from those of their children
    for k in prange(count):
        node = first + k
        for axis in range(3):
            boxes[node, axis] = min(boxes[2 * node + 1, axis], boxes[2 * node + 2, axis])
            boxes[node, 3 + axis] = max(boxes[2 * node + 1, 3 + axis], boxes[2 * node + 2, 3 + axis])


def fit_boxes(
    vertices: np.ndarray, normals: np.ndarray, corners: np.ndarray, deep: float, order: np.ndarray
) -> np.ndarray:
    """Return the boxes (2 leaves - 1, 6) float64 of all nodes: least, then greatest coordinates."""
    leaves = count_leaves(len(order))
    boxes = np.empty((2 * leaves - 1, 6))
    fit_leaves(vertices, normals, corners, deep, order, leaves, boxes)
    count = leaves // 2
    while count >= 1:
        fit_level(count - 1, count, boxes)
        count //= 2
    return boxes


def find_walls(corners: np.ndarray, uv: np.ndarray) -> np.ndarray:
    """(F, 3) uint8: 1 where the side of the prism from corner c to c + 1 is a wall.

    It is one where no face, or several, or one with other texture coordinates (but for whole textures) lie beyond.
    """
    following = np.roll(corners, -1, axis=1)
    low, high = np.minimum(corners, following), np.maximum(corners, following)
    ends = np.stack([uv, np.roll(uv, -1, axis=1)], axis=2)  # (F, 3, 2 ends, 2)
    ends = np.where((corners > following)[..., None, None], ends[:, :, ::-1], ends).reshape(-1, 4)
    key = low.astype(np.int64).ravel() * (int(corners.max()) + 1) + high.ravel()
    order = np.argsort(key, kind="stable")
    _, start, count = np.unique(key[order], return_index=True, return_counts=True)
    walls = np.ones(key.size, np.uint8)
    pair = start[count == 2]
    one, other = order[pair], order[pair + 1]
    shift = ends[one] - ends[other]
    joined = (np.abs(shift - np.round(shift)) < 1e-9).all(axis=1)
    joined &= (np.abs(shift[:, :2] - shift[:, 2:]) < 1e-9).all(axis=1)
    walls[one[joined]] = walls[other[joined]] = 0
    return walls.reshape(corners.shape)
