"""Draft depth of a view: rectified with some neighbours, matched by semi-global matching, and merged."""

from __future__ import annotations

import time

import numpy as np

from ibrpipe.core.patchmatch.plane_fit import fit_planes
from ibrpipe.reconstruction.depth.image_pyramid import Picture
from ibrpipe.reconstruction.depth.job import Job, store
from ibrpipe.reconstruction.depth.patchmatch import pixel_step, relation
from ibrpipe.reconstruction.depth.rectify import Rectified, rectified
from ibrpipe.reconstruction.depth.view_selection import ViewSelection
from ibrpipe.types import Array

#: side of the matched blocks, and the costs of a small and a large step of disparity, per pixel of a block
BLOCK, SMALL, LARGE = 3, 8, 32
#: slopes of grey are cut off here before they are compared
CLIP = 63
#: by how many percent the best disparity must beat all others, and how far left to right and right to left may differ
UNIQUE, LEFT_RIGHT = 5, 1
#: fixed point of OpenCV's disparities
PARTS = 16
#: pixels of motion by which two neighbours' depths may differ to be one
SAME = 1.0
#: half side of the window of the planes, pixels; change of motion per pixel of distance that is still one surface
RADIUS, SLOPE = 2, 0.6
#: disparity between pixels that differs from the nearest one by more lies in mid-air: the nearest is taken
STEP = 0.6


def run_pairs(job: Job, which: int) -> float:
    """Match a view with its neighbours and store its planes as round 0; return the seconds, 0 where they are there."""
    target = job.state_file(0, which)
    if target.is_file():
        return 0.0
    start = time.perf_counter()
    selection, reference = job.selections[which], job.picture(which, 1)
    found: list[tuple[Array, float]] = []
    for other in selection.others:
        if len(found) < job.config.pairs:
            depth = pair_depth(reference, job.picture(other, 1), selection)
            found += [] if depth is None else [depth]
    state = np.zeros((4, *reference.valid.shape), np.float32)
    if found:
        views = np.stack([relation(reference.camera, job.picture(n, 1).camera) for n in selection.others[:3]])
        step = pixel_step(reference.camera, views, float(0.5 / selection.near + 0.5 / selection.far))
        inverse, state[3] = merged(np.stack([q for q, _ in found]), np.array([w for _, w in found]), SAME * step)
        fit_planes(inverse, RADIUS, SLOPE * step, state[:3])
        np.clip(state[0], 0, 1 / selection.near, out=state[0])
    store(target, state)
    return time.perf_counter() - start


def pair_depth(view: Picture, partner: Picture, selection: ViewSelection) -> tuple[Array, float] | None:
    """Inverse depth (H, W) float32 of a view by one neighbour, 0 = unknown, and its weight; None: no such pair."""
    box = _box(view.valid)
    pair = None if box is None else rectified(view.camera, partner.camera, box, selection.near, selection.far)
    if pair is None:
        return None
    disparity = matched(view, partner, pair)
    return _unrectified(disparity, view, pair), (pair.first.K[0, 0] * pair.baseline) ** 2


def matched(view: Picture, partner: Picture, pair: Rectified) -> Array:
    """Disparity of the rectified view, (h, w) float32; NaN = unknown, as is what the partner's mask does not hold."""
    import cv2

    first, second = _turned(view.grey, pair, pair.pixels), _turned(partner.grey, pair, pair.partner_pixels)
    matcher = cv2.StereoSGBM.create(
        minDisparity=0,
        numDisparities=pair.disparities,
        blockSize=BLOCK,
        P1=SMALL * BLOCK * BLOCK,
        P2=LARGE * BLOCK * BLOCK,
        disp12MaxDiff=LEFT_RIGHT,
        preFilterCap=CLIP,
        uniquenessRatio=UNIQUE,
        mode=cv2.STEREO_SGBM_MODE_SGBM_3WAY,
    )
    codes = matcher.compute(np.rint(first).astype(np.uint8), np.rint(second).astype(np.uint8))
    disparity = np.where(codes >= 0, codes.astype(np.float32) / np.float32(PARTS), np.float32(np.nan))
    inside = _turned(partner.valid.astype(np.float32), pair, pair.partner_pixels) > 0.5
    rows, columns = np.nonzero(np.isfinite(disparity))
    there = np.rint(columns - disparity[rows, columns]).astype(np.int64)
    lost = (there < 0) | ~inside[rows, np.maximum(there, 0)]
    disparity[rows[lost], columns[lost]] = np.nan
    return disparity


def merged(inverse: Array, weights: Array, tolerance: float) -> tuple[Array, Array]:
    """Merge what several neighbours say.

    Parameters
    ----------
    inverse : (K, H, W) float32
        0 = unknown.
    weights : (K,) float64
    tolerance : float
        Inverse depths that differ by less are one.

    Returns
    -------
    inverse, cost : (H, W) float32
        Mean of the largest group that lies around one of them, and 1 / (1 + its size); 0 and 1 where all are unknown.
    """
    known = inverse > 0
    best, support = np.zeros(inverse.shape[1:], np.float32), np.zeros(inverse.shape[1:])
    size = np.zeros(inverse.shape[1:], np.float32)
    for k in range(len(inverse)):
        near = known & known[k] & (np.abs(inverse - inverse[k]) <= tolerance)
        weight = np.einsum("k,khw->hw", weights, near)
        total = np.einsum("k,khw->hw", weights, np.where(near, inverse, 0))
        better = weight > support
        best[better] = (total[better] / weight[better]).astype(np.float32)
        size[better], support[better] = near.sum(axis=0)[better], weight[better]
    return best, (1 / (1 + size)).astype(np.float32)


def _box(valid: Array) -> tuple[int, int, int, int] | None:
    rows, columns = np.nonzero(valid.any(axis=1))[0], np.nonzero(valid.any(axis=0))[0]
    if not len(rows):
        return None
    return int(columns[0]), int(rows[0]), int(columns[-1]) + 1, int(rows[-1]) + 1


def _turned(picture: Array, pair: Rectified, pixels: Array) -> Array:
    """Picture of the view or its partner on the common plane; 0 outside."""
    return _warped(picture, pixels, (pair.first.width, pair.first.height), True, 0.0)


def _warped(picture: Array, pixels: Array, size: tuple[int, int], smooth: bool, outside: float) -> Array:
    """Look up a picture at `pixels` (3, 3) of the new picture's pixels, centres at .5."""
    import cv2

    half = np.array([[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1]])
    matrix = np.linalg.inv(half) @ pixels @ half
    flags = cv2.WARP_INVERSE_MAP | (cv2.INTER_LINEAR if smooth else cv2.INTER_NEAREST)
    return cv2.warpPerspective(picture, matrix, size, flags=flags, borderMode=cv2.BORDER_CONSTANT, borderValue=outside)


def _unrectified(disparity: Array, view: Picture, pair: Rectified) -> Array:
    """Inverse depth (H, W) float32 at the view's own pixels, 0 = unknown."""
    height, width = view.valid.shape
    back, size, none = np.linalg.inv(pair.pixels), (width, height), float("nan")
    nearest = _warped(disparity, back, size, False, none)
    smooth = _warped(disparity, back, size, True, none)
    smooth = np.where(np.abs(smooth - nearest) <= STEP, smooth, nearest)
    x, y = np.arange(width)[None, :] + 0.5, np.arange(height)[:, None] + 0.5
    slope = (pair.first.R @ view.camera.R.T)[2] @ view.camera.cam_from_pixel
    along = slope[0] * x + slope[1] * y + slope[2]
    inverse = (smooth - pair.shift) / (pair.first.K[0, 0] * pair.baseline) * along
    return np.where(np.isfinite(inverse) & (inverse > 0) & (view.valid > 0), inverse, 0).astype(np.float32)
