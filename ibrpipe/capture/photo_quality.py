"""One photo's figures: sharpness, clipping, coverage; and which of them are worth telling."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ibrpipe.capture.findings import Limits
from ibrpipe.core.color import luminance, srgb_decode, srgb_encode
from ibrpipe.io.documents.audit import AuditedPhoto, Finding
from ibrpipe.io.photos.image_files import read_header
from ibrpipe.io.views import View
from ibrpipe.types import Array

#: Coded values above 254.5 of 255 count as clipped
CLIPPED = float(srgb_decode(np.float64(254.5 / 255.0)))
#: Coded values below 1.5 of 255 count as black
BLACK = float(srgb_decode(np.float64(1.5 / 255.0)))
#: The robust spread of a normal distribution is this times the median absolute deviation
_MAD = 1.4826


def measure_photo(view: View, colour: Array, mask: Array) -> tuple[float, float, float, float]:
    """Sharpness, clipped share, black share (of the mask's pixels) and covered share of one photo.

    Parameters
    ----------
    view : View
    colour : (H, W, 3) float32
        Linear, as `load_view` returns it.
    mask : (H, W) float32
    """
    import cv2

    inside = mask >= 0.5
    covered = float(inside.mean())
    if not inside.any():
        return 0.0, 0.0, 0.0, 0.0
    stored = colour[inside] / view.factors
    integer = read_header(view.image).integer
    clipped = float((stored.max(axis=1) >= CLIPPED).mean()) if integer else 0.0
    black = float((stored.max(axis=1) <= BLACK).mean())
    grey = np.ascontiguousarray(srgb_encode(luminance(colour / view.factors)))
    inner = cv2.erode(inside.astype(np.uint8), np.ones((5, 5), np.uint8), borderValue=0) > 0
    inner = inner if inner.any() else inside
    return relative_sharpness(grey, inner), clipped, black, covered


def relative_sharpness(grey: Array, inside: Array) -> float:
    """Variance of the Laplacian over that of the luminance itself, of the pixels inside; 0 where all are the same.

    Parameters
    ----------
    grey : (H, W) float32
        Display code, 0 to 1.
    inside : (H, W) bool
    """
    import cv2

    spread = float(grey[inside].var())
    return float(cv2.Laplacian(grey, cv2.CV_32F)[inside].var()) / spread if spread > 1e-8 else 0.0


def damaged(view: View, error: BaseException) -> Finding:
    """A photo that cannot be read."""
    text = str(error) or type(error).__name__
    file = str(view.image)
    value = text.removeprefix(f"{file}: ") if text.startswith(file) else text
    return Finding("error", "unreadable", file, value, "a photo that can be read whole", "replace or remove it")


def empty_mask(view: View) -> Finding:
    """A mask that keeps nothing."""
    file = str(view.mask or view.image)
    remedy = "correct the mask, or remove the photo from the model"
    return Finding("error", "empty mask", file, "the mask keeps no pixel of the photo", "some of it", remedy)


def photo_findings(photos: Sequence[AuditedPhoto], limits: Limits) -> list[Finding]:
    """What is worth telling of the photos' figures."""
    findings = [_blurred(photo, middle) for photo, middle in _blurred_photos(photos, limits.blurred)]
    for photo in photos:
        if photo.clipped > limits.clipped:
            text = f"{photo.clipped:.1%} of its pixels are clipped"
            expected = f"at most {limits.clipped:.0%}"
            findings.append(
                Finding("warning", "clipped", photo.name, text, expected, "expose less, or keep the raw file")
            )
        if photo.black > limits.black and photo.masked:  # without a mask, black is the background
            text, expected = f"{photo.black:.1%} of its pixels are black", f"at most {limits.black:.0%}"
            findings.append(Finding("warning", "black", photo.name, text, expected, "expose more, or correct the mask"))
        if photo.seen == 0 and photo.covered > 0:
            text, expected = "sees nothing of the mesh", "mesh and cameras in one world"
            findings.append(
                Finding("warning", "sees nothing", photo.name, text, expected, "check its pose and its mask")
            )
        elif photo.overlap is not None and photo.overlap < limits.overlap:
            text = f"its mask overlaps the mesh's outline by {photo.overlap:.0%}"
            expected = f"at least {limits.overlap:.0%}"
            findings.append(Finding("warning", "outline", photo.name, text, expected, "check mask, pose and mesh"))
    return findings


def _blurred_photos(photos: Sequence[AuditedPhoto], limit: float) -> list[tuple[AuditedPhoto, float]]:
    """Photos whose sharpness is an outlier below, each with the median."""
    kept = [photo for photo in photos if photo.sharpness > 0]
    if len(kept) < 5:
        return []
    logs = np.log([photo.sharpness for photo in kept])
    middle = float(np.median(logs))
    spread = _MAD * float(np.median(np.abs(logs - middle)))
    floor = middle - max(limit * spread, math.log(2.0))
    return [(photo, math.exp(middle)) for photo, value in zip(kept, logs) if value < floor]


def _blurred(photo: AuditedPhoto, middle: float) -> Finding:
    text = f"looks blurred (sharpness {photo.sharpness:.3g})"
    return Finding("warning", "blurred", photo.name, text, f"about {middle:.3g}", "take it again or remove it")
