"""Masks of objects before a dark background, from brightness alone."""

from __future__ import annotations

import numpy as np

from ibrpipe.core.color import luminance, srgb_encode
from ibrpipe.types import Array

#: parts smaller than this share of the largest one, and holes smaller than this share of the object, are specks
PART, HOLE = 0.05, 0.003


def threshold_mask(color: Array, threshold: float) -> Array:
    """Return (H, W) float32 coverage of what is brighter than a threshold; specks are cleaned away.

    Parameters
    ----------
    color : (H, W, 3) float32
        Linear.
    threshold : float
        0..1, in display code: 0.1 is code 26 of 255.
    """
    import cv2

    bright = srgb_encode(luminance(color), np.inf) >= threshold
    bright = cv2.morphologyEx(bright.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    return _without_specks(1 - _without_specks(bright, PART), HOLE, bright.sum(), 1).astype(np.float32)


def _without_specks(marked: Array, share: float, whole: float | None = None, other: int = 0) -> Array:
    """Drop parts with fewer pixels than a share of the largest one, or of `whole`; `other` = 1 inverts the result."""
    import cv2

    count, label, figures, _ = cv2.connectedComponentsWithStats(marked.astype(np.uint8), connectivity=8)
    size = figures[:, cv2.CC_STAT_AREA].astype(float)
    size[0] = 0
    kept = size >= share * (size.max() if whole is None else max(whole, 1))
    kept[0] = False
    found = kept[label] if count > 1 else np.zeros(marked.shape, bool)
    return (found != bool(other)).astype(np.uint8)
