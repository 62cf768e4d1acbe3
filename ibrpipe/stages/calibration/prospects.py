"""A quick look at the matches of two photos: whether COLMAP's thorough check of a common geometry is worth its time.

COLMAP tries up to 10000 samples for each of several models before it gives a pair up. OpenCV's search (USAC) gives
wrong pairs up early.
"""

from __future__ import annotations

from ibrpipe.types import Array

#: COLMAP's bounds: matches that agree at the least, and pixels that they may be off
LEAST, NEAR = 15, 4.0
_TRIALS, _SURE = 10000, 0.999


def may_share_geometry(one: Array, other: Array) -> bool:
    """Say whether enough matches of two photos agree with one fundamental matrix.

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
