"""Which photos are compared with which: all, neighbours in the sequence, or those that look alike.

Looking alike is found without any vocabulary by comparing few large features of all photos with each other (wu2013,
"preemptive matching").
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from ibrpipe.calibration.matching import matching
from ibrpipe.types import Array

Pair = tuple[int, int]

#: Up to this many photos every pair is compared
EXHAUSTIVE = 60
#: Large features of each photo that are compared to see whether photos look alike
LARGE = 384


def all_pairs(count: int) -> list[Pair]:
    """Every pair once, in order."""
    return list(itertools.combinations(range(count), 2))


def sequential_pairs(count: int, overlap: int) -> list[Pair]:
    """Pairs at most `overlap` apart, and pairs 2^k apart beyond."""
    steps = set(range(1, overlap + 1)) | {overlap << k for k in range(1, 8)}
    return sorted((i, i + step) for step in steps for i in range(count - step) if step < count)


def similar_pairs(keypoints: Sequence[Array], descriptors: Sequence[Array], neighbours: int) -> list[Pair]:
    """Pairs of photos that look alike.

    Parameters
    ----------
    keypoints : sequence of (N, 4) float32
        Third column: size.
    descriptors : sequence of (N, 128) uint8
    neighbours : int
        Partners of each photo that are kept, best first.

    Returns
    -------
    list of (int, int)
        Ascending.
    """
    large = [_largest(spots, vectors) for spots, vectors in zip(keypoints, descriptors)]
    count = len(large)
    matches = np.zeros((count, count), np.int32)
    for i, j in all_pairs(count):
        matches[i, j] = matches[j, i] = len(matching(large[i], large[j]))
    pairs: set[Pair] = set()
    for i in range(count):
        for j in np.argsort(-matches[i], kind="stable")[:neighbours].tolist():
            if matches[i, j] > 0 and i != j:
                pairs.add((min(i, j), max(i, j)))
    return sorted(pairs)


def _largest(spots: Array, vectors: Array) -> Array:
    order = np.argsort(-spots[:, 2], kind="stable")[:LARGE]
    return vectors[order].astype(np.float32)
