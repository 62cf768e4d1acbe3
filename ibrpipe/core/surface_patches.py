"""Patches of a triangle mesh that can be wound one way, and which of their faces are wound the other way.

Faces that share an edge with nobody else are wound alike where they run along it in opposite directions. The double
cover of the mesh has two nodes a face, one a way of winding; what hangs together in it is one patch wound one way, so a
patch is a pair of components, or a single one where it is a Moebius strip.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from ibrpipe.core.normals import weld


def spare(corners):
    """(F,) bool: faces (F, 3) of welded vertices that repeat an earlier one, wound any way, or have equal corners."""
    _, first = np.unique(np.sort(corners, axis=1), axis=0, return_index=True)
    out = np.ones(len(corners), bool)
    out[first] = False
    return out | (corners == np.roll(corners, 1, axis=1)).any(axis=1)


def shared_edges(corners):
    """Edges of exactly two of the faces (F, 3).

    Pairs of faces (E, 2) i64; (E,) bool whether both run along the edge the same way; (F,) bool whether all three edges
    of a face are such.
    """
    half = np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]])
    rising, face = half[:, 0] < half[:, 1], np.tile(np.arange(len(corners)), 3)
    key = half.min(axis=1) * (int(corners.max(initial=0)) + 1) + half.max(axis=1)
    order = np.argsort(key, kind="stable")
    starts = np.flatnonzero(np.diff(key[order], prepend=-1))
    pairs = starts[np.diff(starts, append=len(key)) == 2]
    one, two = order[pairs], order[pairs + 1]
    paired = np.zeros(len(key), bool)
    paired[one] = paired[two] = True
    return np.stack([face[one], face[two]], axis=1), rising[one] == rising[two], paired.reshape(3, -1).all(axis=0)


def patches(vertices, faces):
    """Patches of a mesh: (F,) i64 patch of every face, (F,) bool wound against the most of it, (P,) bool closed.

    Vertices at one place are one. Faces that repeat another, or have two corners at one place, have no patch (-1).
    """
    corners = weld(vertices)[faces].astype(np.int64)
    again, count = spare(corners), len(faces)
    kept = np.flatnonzero(~again)
    pairs, alike, whole = shared_edges(corners[kept])
    one, two = pairs.T
    n = len(kept)
    rows, columns = np.concatenate([one, one + n]), np.concatenate([two + n * alike, two + n * ~alike])
    _, label = connected_components(coo_array((np.ones(len(rows), np.int8), (rows, columns)), shape=(2 * n, 2 * n)))
    first, second = label[:n], label[n:]
    _, patch = np.unique(np.minimum(first, second), return_inverse=True)
    against = first > second
    most = np.bincount(patch, np.where(against, 1.0, -1.0)) > 0
    out, turned = np.full(count, -1, np.int64), np.zeros(count, bool)
    out[kept], turned[kept] = patch, against != (most[patch] & (first != second))
    closed = np.bincount(patch, ~whole) == 0
    return out, turned, closed
