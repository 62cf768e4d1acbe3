"""Features of two photos that match: nearest to each other, and clearly nearer than the next.

The search is exact. Descriptors are whole numbers, so their products are exact in float32 whatever the order of the
sums, and neither threads nor processors decide differently. (COLMAP's own search on the CPU is approximate, and gives
other matches now and then.)
"""

from __future__ import annotations

import numpy as np

from ibrpipe.types import Array

#: A nearest descriptor counts when its angle is at most this share of the second nearest's (lowe2004)
RATIO = 0.8
#: and at most this many radians
WIDEST = 0.7
#: Length of a descriptor, squared
_LENGTH = 512.0**2
#: Rows of the table of products that are held at a time
_ROWS = 256


def matching(one: Array, other: Array) -> Array:
    """Return the matches of two photos' descriptors.

    Parameters
    ----------
    one, other : (N, 128), (M, 128) float32
        Whole numbers of 0 to 255, each row about 512 long.

    Returns
    -------
    (K, 2) uint32
        Row of `one`, row of `other`; ascending.
    """
    if len(one) < 2 or len(other) < 2:
        return np.empty((0, 2), np.uint32)
    best, first, second = np.empty(len(one), np.int64), np.empty(len(one)), np.empty(len(one))
    most = np.full(len(other), -1.0, np.float32)
    for start in range(0, len(one), _ROWS):
        table = one[start : start + _ROWS] @ other.T
        rows, part = np.arange(len(table)), slice(start, start + len(table))
        np.maximum(most, table.max(axis=0), out=most)
        best[part] = table.argmax(axis=1)
        first[part] = table[rows, best[part]]
        table[rows, best[part]] = -1.0
        second[part] = table.max(axis=1)
    near, far = _angle(first), _angle(second)
    kept = np.nonzero((first == most[best]) & (near < RATIO * far) & (near <= WIDEST))[0]
    kept = kept[np.sort(np.unique(best[kept], return_index=True)[1])]  # of equals the first
    return np.stack([kept, best[kept]], axis=1).astype(np.uint32)


def _angle(product: Array) -> Array:
    return np.arccos(np.minimum(product / _LENGTH, 1.0))


#: COLMAP's bounds: matches that agree at the least, and pixels that they may be off
LEAST, NEAR = 15, 4.0


_TRIALS, _SURE = 10000, 0.999


def may_share_geometry(one: Array, other: Array) -> bool:
    """Say whether enough matches of two photos agree with one fundamental matrix (raguram2013, as OpenCV has it).

    A known focal length, a plane or a pure rotation are special cases of it, so that none of them is missed.

    Parameters
    ----------
    one, other : (N, 2) float32
        Places of the matches, pixels.
    """
    import cv2

    if len(one) < LEAST:
        return False
    _, agree = cv2.findFundamentalMat(one, other, cv2.USAC_DEFAULT, NEAR, _SURE, _TRIALS)
    return agree is not None and int(agree.sum()) >= LEAST
