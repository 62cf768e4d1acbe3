"""Whether masks keep the object or what is around it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ibrpipe.io.documents.audit import Finding, Severity
from ibrpipe.types import Array

_EXPECTED = "masks that are white where the object is"
_REMEDY = "invert them, for instance with `magick mogrify -negate masks/*.png`"
#: Masks that hardly overlap the mesh's outline, whose inverse overlaps it by more than this, are told; and stop the run
#: where that is certain. A mesh of another size or place overlaps both.
HARDLY, MORE, CERTAIN = 0.1, 0.3, 0.5
#: Without a mesh: share of the rim that is kept, of the picture that is left out, and of the photos that show both
RIM, LEFT_OUT, MOST = 0.95, 0.05, 0.8


def inverted_masks(root: Path, overlaps: Sequence[tuple[float, float]]) -> list[Finding]:
    """Tell that masks leave out what the mesh covers.

    Parameters
    ----------
    root : Path
    overlaps : sequence of (float, float)
        For every photo with a mask: how far the mask, and how far its inverse, overlaps the mesh's outline.
    """
    if not overlaps:
        return []
    kept, left = np.median(np.array(overlaps), axis=0)
    if kept > HARDLY or left < MORE:
        return []
    text = f"masks look inverted: the mesh's outline overlaps what they keep by {kept:.0%}, what they leave out by "
    severity: Severity = "error" if left > CERTAIN else "warning"
    return [Finding(severity, "inverted masks", str(root), f"{text}{left:.0%}", _EXPECTED, _REMEDY)]


def keeps_rim(mask: Array) -> bool:
    """Whether a mask keeps the picture's rim and leaves something out inside."""
    kept = mask >= 0.5
    rim = np.concatenate([kept[0], kept[-1], kept[:, 0], kept[:, -1]])
    return bool(rim.mean() > RIM and kept.mean() < 1 - LEFT_OUT)


def perhaps_inverted(root: Path, rims: Sequence[bool]) -> list[Finding]:
    """Tell that most masks keep the rim of the picture and leave out its middle."""
    if not rims or sum(rims) < MOST * len(rims):
        return []
    text = f"{sum(rims)} of {len(rims)} masks keep the rim of the picture and leave out a part inside"
    remedy = f"if the object is what they leave out, {_REMEDY}"
    return [Finding("warning", "inverted masks", str(root), text, _EXPECTED, remedy)]
