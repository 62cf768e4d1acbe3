"""Whether a mesh and the cameras around it are in the same units."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ibrpipe.io.documents.audit import Finding, Severity
from ibrpipe.types import Array

#: A mesh so many times larger or smaller than the ring of cameras is told; one that is seen from behind earlier
FAR, INSIDE = 50.0, 5.0
#: Masks that overlap the outline less than this show that the mesh is not what photos see; from inside it fills them
NO_OVERLAP, NO_ROOM = 0.1, 0.5
#: Share of all directions in which a mesh is met from inside it
AROUND = 0.9


def other_units(
    file: str, diagonal: float, centers: Array, sides: tuple[float, float], overlap: float | None, seen: bool
) -> Finding | None:
    """Tell that a mesh is far larger or smaller than the ring of cameras.

    How faces are wound decides nothing by itself: backs are told only where the mesh is all around the cameras. Such a
    mesh is an error where it is far too large, or where masks show that the photos are not of a room.

    Parameters
    ----------
    file : str
    diagonal : float
        Of the mesh's bounding box, scene units.
    centers : (N, 3) float64
        Of the cameras.
    sides : (float, float)
        Median share of the mesh's visible pixels that show the back of a face, NaN = nothing is visible; median share
        of all directions in which the cameras' places meet the mesh.
    overlap : float or None
        Median overlap of masks with the outline; None = no masks.
    seen : bool
        Some photo sees some of the mesh.
    """
    ring = 2.0 * float(np.median(np.linalg.norm(centers - np.median(centers, axis=0), axis=1)))
    if not (ring > 0 and diagonal > 0):
        return None
    ratio = diagonal / ring
    backs, around = sides
    behind = backs > 0.5 and around >= AROUND
    if not (ratio > (INSIDE if behind else FAR) or ratio < 1.0 / FAR):
        return None
    factor, word = (ratio, "larger") if ratio > 1 else (1.0 / ratio, "smaller")
    text = f"the mesh is {factor:.0f} times {word} than the ring of cameras"
    text += ", which are inside it and see its faces from behind" if behind else ""
    remedy = "scale one of them (millimetres beside metres: by 1000)"
    remedy += "; a room stays as it is, the plan turns its faces" if behind and ratio < FAR else ""
    apart = overlap is not None and overlap < (NO_ROOM if behind else NO_OVERLAP)
    wrong = not seen or apart or (behind and ratio > FAR)
    severity: Severity = "error" if wrong else "warning"
    return Finding(severity, "units", file, text, "mesh and cameras in the same units", remedy)


def median_or_nan(values: Sequence[float]) -> float:
    """Return the median of the finite values, NaN where there are none."""
    known = [value for value in values if np.isfinite(value)]
    return float(np.median(known)) if known else float("nan")
