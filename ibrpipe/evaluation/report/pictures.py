"""Pictures of the report: photo, renders, differences and highlight pixels, as data URIs."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from ibrpipe.evaluation.image_scores import Truth, to_srgb8
from ibrpipe.evaluation.metrics import Scores, ViewMetrics
from ibrpipe.types import Array, Frame

#: how much differences are amplified
GAIN = 4
PAPER = (250, 250, 248)
HIGHLIGHT = (214, 40, 90)
#: where a method shows nothing
UNCOVERED = (206, 212, 218)
_MARGIN = 6
_QUALITY = 93


@dataclass(frozen=True)
class Column:
    """One method's picture of a view: its name, scores, picture and amplified difference from the photo."""

    name: str
    scores: Scores
    picture: str
    difference: str


@dataclass(frozen=True)
class ViewPictures:
    """All pictures of one held-out view, as data URIs."""

    name: str
    width: int
    height: int
    photo: str
    highlights: str
    highlight_share: float
    columns: tuple[Column, ...] = field(default=())


def draw_view(
    metrics: ViewMetrics, truth: Truth, frames: Mapping[str, Frame], highlights: Array, width: int
) -> ViewPictures:
    """Draw one view, cropped to its mask.

    Parameters
    ----------
    metrics : ViewMetrics
        Scores that stand below the pictures.
    truth : Truth
    frames : mapping of name to Frame
        Rendered pictures; where they are not covered, a flat grey is drawn.
    highlights : (H, W) bool
    width : int
        Widest picture in pixels; larger ones are shrunk.
    """
    crop = _crop(truth.mask)
    mask = truth.mask[crop]
    shown = [name for name in (*metrics.renderers, "diffuse", "ulr") if name in frames]
    scores = {**metrics.renderers, **metrics.baselines}
    columns = tuple(
        Column(
            name, scores[name], *(jpeg(_on_paper(drawn[crop], mask), width) for drawn in _drawn(truth, frames[name]))
        )
        for name in shown
    )
    covered = metrics.mask_pixels if metrics.covered_pixels is None else metrics.covered_pixels
    return ViewPictures(
        name=metrics.name,
        width=min(width, mask.shape[1]),
        height=round(mask.shape[0] * min(1.0, width / mask.shape[1])),
        photo=jpeg(_on_paper(truth.color[crop], mask), width),
        highlights=jpeg(_on_paper(_marked(truth.color[crop], highlights[crop]), mask), width),
        highlight_share=metrics.highlight_pixels / max(covered, 1),
        columns=columns,
    )


def _drawn(truth: Truth, frame: Frame) -> tuple[Array, Array]:
    """Return a frame's picture and its difference from the photo, both grey where it is not covered."""
    assert frame.color is not None
    codes = to_srgb8(frame.color)
    shown = np.ones(codes.shape[:2], bool) if frame.alpha is None else frame.alpha >= 0.5
    grey = np.array(UNCOVERED, np.uint8)
    both = codes, _heat(truth.color, codes)
    return np.where(shown[..., None], both[0], grey), np.where(shown[..., None], both[1], grey)


def heat_colors() -> Array:
    """Return the colour of every amplified difference 0..255, (256, 3) uint8."""
    from matplotlib import colormaps

    return np.rint(255.0 * colormaps["inferno"](np.arange(256))[:, :3]).astype(np.uint8)


def _heat(truth: Array, picture: Array) -> Array:
    """Colour the greatest difference of the three channels, amplified `GAIN` times, 255 at most."""
    difference = np.abs(truth.astype(np.int16) - picture).max(axis=2)
    return heat_colors()[np.minimum(difference * GAIN, 255)]


def _marked(truth: Array, highlights: Array) -> Array:
    """Return the photo in pale grey with the highlight pixels coloured."""
    grey = (128 + truth.mean(axis=2) / 2).astype(np.uint8)
    return np.where(highlights[..., None], np.array(HIGHLIGHT, np.uint8), grey[..., None])


def _on_paper(picture: Array, mask: Array) -> Array:
    return np.where(mask[..., None], picture, np.array(PAPER, np.uint8))


def _crop(mask: Array) -> tuple[slice, slice]:
    """Return the mask's bounding box with a small margin; all of the picture where the mask is empty."""
    if not mask.any():
        return slice(None), slice(None)
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    return (
        slice(max(0, int(rows[0]) - _MARGIN), int(rows[-1]) + 1 + _MARGIN),
        slice(max(0, int(columns[0]) - _MARGIN), int(columns[-1]) + 1 + _MARGIN),
    )


def jpeg(picture: Array, width: int) -> str:
    """Return a data URI of (H, W, 3) uint8, no wider than `width`; full colour resolution."""
    import cv2

    if picture.shape[1] > width:
        size = (width, max(1, round(picture.shape[0] * width / picture.shape[1])))
        picture = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
    settings = [
        cv2.IMWRITE_JPEG_QUALITY,
        _QUALITY,
        cv2.IMWRITE_JPEG_SAMPLING_FACTOR,
        cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444,
    ]
    _, encoded = cv2.imencode(".jpg", np.ascontiguousarray(picture[:, :, ::-1]), settings)
    return "data:image/jpeg;base64," + b64encode(encoded.tobytes()).decode("ascii")
