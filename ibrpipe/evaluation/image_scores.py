"""How far a picture is from the photo: PSNR, SSIM, FLIP, depth, coverage, all inside the mask.

Pictures are (H, W, 3) uint8, sRGB-coded. Outside the mask both pictures are set to black, so that windows and filters
which reach over the silhouette meet no difference there; only mask pixels are averaged. Uncovered pixels are black in
the render and count as such, except in the figures over covered pixels.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from ibrpipe.core.color import srgb_encode, to_bytes
from ibrpipe.core.psnr import psnr
from ibrpipe.errors import ShapeError
from ibrpipe.evaluation.metrics import Scores
from ibrpipe.types import Array, Frame

MASK_THRESHOLD = 0.5
SSIM_SIDE = 7
SSIM_WINDOW = "uniform, 7 x 7 pixels (scikit-image's default)"
FLIP_PPD = 67.02064514160156
#: pixels beyond which nothing reaches through FLIP's filters, 10 at `FLIP_PPD`, and some more
FLIP_MARGIN = 24


@dataclass(frozen=True, eq=False)
class Truth:
    """A held-out view as the scores want it.

    Attributes
    ----------
    color : (H, W, 3) uint8, sRGB
    mask : (H, W) bool
    depth : (H, W) float32 along camera z, +inf = nothing; None = unknown
    """

    color: Array
    mask: Array
    depth: Array | None = None

    def __post_init__(self) -> None:
        shape = self.color.shape[:2]
        if self.color.dtype != np.uint8 or self.color.shape != (*shape, 3):
            raise ShapeError(f"truth must be (H, W, 3) uint8, got {self.color.shape} {self.color.dtype}")
        if self.mask.shape != shape or self.mask.dtype != bool:
            raise ShapeError(f"mask must be {shape} bool, got {self.mask.shape} {self.mask.dtype}")
        if self.depth is not None and self.depth.shape != shape:
            raise ShapeError(f"truth depth must be {shape}, got {self.depth.shape}")


def to_srgb8(linear: Array) -> Array:
    """Return linear colour as 8-bit sRGB codes, rounded to nearest, light outside 0..1 clipped."""
    return to_bytes(srgb_encode(linear))


def ssim(truth: Array, picture: Array, mask: Array) -> float | None:
    """Return structural similarity (wang2004), the map's mean over mask and channels.

    Raises
    ------
    ShapeError
        A side is shorter than the window.
    """
    if not mask.any():
        return None
    if min(mask.shape) < SSIM_SIDE:
        raise ShapeError(f"SSIM needs pictures of at least {SSIM_SIDE} pixels a side, got {mask.shape[::-1]}")
    from skimage.metrics import structural_similarity

    rows, columns = _window(mask, SSIM_SIDE)
    pair = [blackened(coded, mask)[rows, columns] for coded in (truth, picture)]
    _, similarity = structural_similarity(*pair, win_size=SSIM_SIDE, channel_axis=2, data_range=255, full=True)
    return float(similarity[mask[rows, columns]].mean(dtype=np.float64))


def flip_map(truth: Array, picture: Array, mask: Array) -> Array:
    """Return the LDR-FLIP error map (H, W) float32 in 0..1 (andersson2020) at `FLIP_PPD` pixels per degree."""
    import flip_evaluator

    pair = [np.float32(blackened(coded, mask)) / np.float32(255.0) for coded in (truth, picture)]
    found, _, _ = flip_evaluator.evaluate(
        pair[0], pair[1], "LDR", inputsRGB=True, applyMagma=False, computeMeanError=False, parameters={"ppd": FLIP_PPD}
    )
    return np.asarray(found, np.float32)[..., 0]


def flip(truth: Array, picture: Array, mask: Array) -> float | None:
    """Return the mean of `flip_map` over the mask; None for an empty mask.

    Only the mask's surroundings are filtered, as far as FLIP's filters reach: the figure is the same.
    """
    if not mask.any():
        return None
    near = _window(mask, FLIP_MARGIN)
    return float(flip_map(truth[near], picture[near], mask[near])[mask[near]].mean(dtype=np.float64))


def depth_errors(truth: Array, depth: Array, mask: Array) -> tuple[float | None, float | None]:
    """Return RMSE and median absolute error over the mask pixels that both hit; None, None where there are none."""
    both = mask & np.isfinite(truth) & np.isfinite(depth)
    if not both.any():
        return None, None
    error = truth[both].astype(np.float64) - depth[both]
    return float(np.sqrt(np.mean(error**2))), float(np.median(np.abs(error)))


def coverage(alpha: Array, mask: Array) -> float | None:
    """Return the share of mask pixels whose alpha is at least one half; None for an empty mask."""
    return float(np.mean(alpha[mask] >= 0.5)) if mask.any() else None


def highlight_pixels(truth: Array, diffuse: Array, mask: Array, threshold: int) -> Array:
    """Return the mask pixels where some channel of truth and diffuse-only differ by `threshold` codes or more.

    Only patches of at least 3 x 3 such pixels are kept (morphological opening): thin lines along edges and silhouettes
    come from sampling, not from highlights.
    """
    from scipy.ndimage import binary_opening

    difference = np.abs(truth.astype(np.int16) - diffuse).max(axis=2)
    return binary_opening(mask & (difference >= threshold), np.ones((3, 3), bool))


def covered_pixels(frames: Iterable[Frame], mask: Array) -> Array:
    """Return the mask pixels (H, W) that every one of the frames covers; a frame without alpha covers all."""
    covered = mask.copy()
    for frame in frames:
        if frame.alpha is not None:
            covered &= frame.alpha >= 0.5
    return covered


def score_frame(truth: Truth, frame: Frame, highlights: Array | None = None, covered: Array | None = None) -> Scores:
    """Score a rendered frame against a held-out view.

    Parameters
    ----------
    truth : Truth
    frame : Frame
        With color; depth and alpha where they are known.
    highlights : (H, W) bool, optional
        Part of the mask that is scored on its own too.
    covered : (H, W) bool, optional
        Part of the mask that the second set of figures is taken over.
    """
    if frame.color is None or frame.color.shape != truth.color.shape:
        got = None if frame.color is None else frame.color.shape
        raise ShapeError(f"the rendered colour is {got} but the held-out photo is {truth.color.shape}")
    picture = to_srgb8(frame.color)
    alpha = np.ones(truth.mask.shape) if frame.alpha is None else frame.alpha
    rmse, median = None, None
    if truth.depth is not None and frame.depth is not None:
        rmse, median = depth_errors(truth.depth, frame.depth, truth.mask)
    inside = truth.mask if covered is None else covered
    whole = _similarity(truth, picture, truth.mask)
    within = whole if np.array_equal(inside, truth.mask) else _similarity(truth, picture, inside)
    return Scores(
        **whole,
        depth_rmse=rmse,
        depth_median=median,
        coverage=coverage(alpha, truth.mask),
        **({} if covered is None else {f"{name}_covered": value for name, value in within.items()}),
        psnr_highlight=None if highlights is None else psnr(truth.color, picture, highlights),
        psnr_rest=None if highlights is None else psnr(truth.color, picture, inside & ~highlights),
    )


def _similarity(truth: Truth, picture: Array, mask: Array) -> dict[str, float | None]:
    """Return the figures of likeness over the pixels of `mask`."""
    return {
        "psnr": psnr(truth.color, picture, mask),
        "ssim": ssim(truth.color, picture, mask),
        "flip": flip(truth.color, picture, mask),
    }


def blackened(picture: Array, mask: Array) -> Array:
    """Return `picture` with black outside the mask."""
    return np.where(mask[..., None], picture, picture.dtype.type(0))


def _window(mask: Array, margin: int) -> tuple[slice, slice]:
    """Return the mask's bounding box and a margin, at least as large as the margin itself."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    return (
        slice(max(0, int(rows[0]) - margin), int(rows[-1]) + 1 + margin),
        slice(max(0, int(columns[0]) - margin), int(columns[-1]) + 1 + margin),
    )
