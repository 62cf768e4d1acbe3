"""Frames of a video that serve as photos: the sharpest of every step that the camera makes.

The camera's way is measured in the picture: how far features move from frame to frame. It is cut into equal steps, as
many as frames are wanted, and each step gives its sharpest frame, so that a camera that rests or hurries does not
crowd or thin out the photos.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from ibrpipe.capture.photo_quality import relative_sharpness
from ibrpipe.types import Array

#: longer side at which frames are looked at, pixels
LOOKED_AT = 640
#: way between two photos at the least, share of the longer side: less is no new view
LEAST_STEP = 0.01
#: a frame whose brightest pixels (95th percentile, display code) are below this is too dark
DARK = 0.12
#: a frame this much less sharp than the frames around it (and than all of them) is blurred
BLURRED, BLURRED_BY_FAR = 0.5, 0.25
#: frames before and after that count as around
AROUND = 30
#: features that are followed at most, their least quality beside the best, and least distance in pixels
FEATURES, QUALITY, APART = 300, 0.01, 8.0


@dataclass(frozen=True, eq=False)
class FrameFigures:
    """What was measured in every frame of a video.

    Attributes
    ----------
    sharpness : (N,) float64
        As the audit measures photos.
    bright : (N,) float64
        95th percentile of the display code, 0 to 1.
    motion : (N,) float64
        Median way of features since the frame before, share of the longer side; NaN = none could be followed.
    """

    sharpness: Array
    bright: Array
    motion: Array


@dataclass(frozen=True)
class ChosenFrames:
    """Which frames serve as photos, and why not the others.

    Attributes
    ----------
    frames : tuple of int
        Ascending, from 0.
    total, dark, blurred : int
        All frames; those too dark, and those blurred.
    most : int
        Frames that the camera's way would give at the most.
    """

    frames: tuple[int, ...]
    total: int
    dark: int
    blurred: int
    most: int

    def told(self, wanted: int) -> str:
        """Return the choice in words, where `wanted` frames were asked for."""
        left = [f"{count} {word}" for count, word in ((self.dark, "too dark"), (self.blurred, "blurred")) if count]
        text = f"{len(self.frames)} of {self.total} frames are taken, the sharpest of every step of the camera"
        text += f"; {' and '.join(left)} left out" if left else ""
        few = self.most < min(wanted, self.total)
        return text + (f"; the camera moves too little for {wanted} different photos" if few else "")


def measure_frames(frames: Iterable[Array]) -> FrameFigures:
    """Measure the frames of a video, (H, W, 3) uint8 each, in order."""
    rows, before = [], None
    for frame in frames:
        grey = _small_grey(frame)
        motion = np.nan if before is None else _motion(before, grey)
        code = grey.astype(np.float32) / 255.0
        rows.append((relative_sharpness(code, np.ones(code.shape, bool)), np.percentile(code, 95), motion))
        before = grey
    return FrameFigures(*np.array(rows, np.float64).reshape(-1, 3).T)


def choose_frames(figures: FrameFigures, wanted: int) -> ChosenFrames:
    """Choose at most `wanted` frames.

    Parameters
    ----------
    figures : FrameFigures
    wanted : int
        At least 1.
    """
    total = len(figures.sharpness)
    dark = figures.bright < DARK
    blurred = ~dark & _blurred(figures.sharpness, dark)
    way = _way(figures.motion)
    most = int(way[-1] / LEAST_STEP) + 1 if total else 0
    usable = np.flatnonzero(~dark & ~blurred)
    steps, chosen = min(wanted, most), tuple[int, ...]()
    while True:  # steps over which the camera jumps, or that are all blurred, give nothing: then shorter ones
        found = _sharpest(figures.sharpness, way, usable, steps)
        chosen = found if len(found) <= wanted else chosen
        if len(found) >= wanted or steps >= most:
            return ChosenFrames(chosen, total, int(dark.sum()), int(blurred.sum()), most)
        steps = min(most, steps + 1 + steps // 20)


def _sharpest(sharpness: Array, way: Array, usable: Array, steps: int) -> tuple[int, ...]:
    """Return the sharpest usable frame of every one of so many equal steps, where there is any."""
    step = np.minimum((way * (steps / max(float(way[-1]), 1e-12))).astype(int), steps - 1)
    best: dict[int, int] = {}
    for frame in usable.tolist():
        known = best.setdefault(int(step[frame]), frame)
        if sharpness[frame] > sharpness[known]:
            best[int(step[frame])] = frame
    return tuple(sorted(best.values()))


def _small_grey(frame: Array) -> Array:
    import cv2

    grey = cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY)
    scale = LOOKED_AT / max(grey.shape)
    if scale >= 1:
        return grey
    size = (max(1, round(grey.shape[1] * scale)), max(1, round(grey.shape[0] * scale)))
    return cv2.resize(grey, size, interpolation=cv2.INTER_AREA)


def _motion(before: Array, after: Array) -> float:
    """Median way of features between two frames (H, W) uint8, share of the longer side; NaN = none is found again."""
    import cv2

    corners = cv2.goodFeaturesToTrack(before, FEATURES, QUALITY, APART)
    if corners is None:
        return float("nan")
    moved, found, _ = cv2.calcOpticalFlowPyrLK(before, after, corners, None)
    there = found.ravel() == 1
    if not there.any():
        return float("nan")
    ways = np.linalg.norm((moved - corners).reshape(-1, 2)[there], axis=1)
    return float(np.median(ways)) / max(before.shape)


def _way(motion: Array) -> Array:
    """Return how far the camera has come at every frame, (N,); where nothing could be followed, as far as usual."""
    known = motion[np.isfinite(motion)]
    usual = float(np.median(known)) if len(known) else LEAST_STEP
    steps = np.where(np.isfinite(motion), motion, usual)
    steps[:1] = 0.0
    return np.cumsum(steps)


def _blurred(sharpness: Array, dark: Array) -> Array:
    """Return which frames are blurred, (N,) bool, against the others that are bright enough."""
    blurred = np.zeros(len(sharpness), bool)
    if dark.all():
        return blurred
    middle = float(np.median(sharpness[~dark]))
    for frame in range(len(sharpness)):
        near = slice(max(frame - AROUND, 0), frame + AROUND + 1)
        around = sharpness[near][~dark[near]]
        usual = float(np.median(around)) if len(around) else middle
        blurred[frame] = sharpness[frame] < max(BLURRED * usual, BLURRED_BY_FAR * middle)
    return blurred
