"""Which method of making a surface fits what was measured, and why."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ibrpipe.io.views import View
from ibrpipe.reconstruction.surface.settings import Method, SurfaceConfig
from ibrpipe.reconstruction.surface.silhouettes import Outline
from ibrpipe.types import Array

#: photos whose mask may reach the border of the picture when an object counts as wholly shown, share
CUT_OFF = 0.3
#: length of the mean of the directions to the cameras up to which they stand around the object; a ring that looks down
#: by 45 degrees has 0.71, cameras on one side of it more than 0.75
AROUND = 0.72


@dataclass(frozen=True)
class Choice:
    """A method of making a surface.

    Attributes
    ----------
    method : str
        "volume", "poisson" or "hull".
    hull_completion : bool
        The visual hull closes what no depth shows.
    reason : str
    measured : dict
        The figures behind it.
    """

    method: Method
    hull_completion: bool
    reason: str
    measured: dict[str, Any]


def choose(
    config: SurfaceConfig,
    views: Sequence[View],
    outlines: Sequence[Outline],
    depth_share: float,
    center: np.ndarray | None,
) -> Choice:
    """Choose the method and whether the hull completes it.

    Parameters
    ----------
    config : SurfaceConfig
    views : sequence of View
    outlines : sequence of Outline
        Empty where the photos have no masks.
    depth_share : float
        Share of the masks' pixels with depth that other views confirm.
    center : (3,) or None
        Middle of what was found.
    """
    masked = sum(view.masked for view in views)
    cut = sum(outline.touches for outline in outlines) / max(len(outlines), 1)
    spread = _spread(views, center)
    measured = {
        "photos": len(views),
        "photos_with_mask": masked,
        "masks_cut_off": round(cut, 3),
        "mean_direction": round(spread, 3),
        "agreed_depth": round(depth_share, 4),
    }
    whole = bool(outlines) and cut <= CUT_OFF and spread <= AROUND
    wish = config.hull_completion
    complete = wish == "always" or (wish == "auto" and whole)
    if config.method != "auto":
        complete = config.method == "hull" or (config.method == "poisson" and complete and bool(outlines))
        return Choice(config.method, complete, "set by the pipeline file", measured)
    if whole and depth_share < config.depth_share:
        why = f"only {depth_share:.0%} of the masks' pixels have agreed depth; the masks show the whole object"
        return Choice("hull", True, why, measured)
    if whole:
        why = (
            f"{depth_share:.0%} of the masks' pixels have agreed depth, and the masks show the whole object from around"
        )
        return Choice("poisson", complete, why, measured)
    lacking = "there are no masks" if not outlines else "the masks do not show a whole object from around"
    why = f"{depth_share:.0%} of the pixels have agreed depth; {lacking}, so what was not seen stays open"
    return Choice("poisson", complete and bool(outlines), why, measured)


def _spread(views: Sequence[View], center: Array | None) -> float:
    """Length of the mean direction from the middle to the cameras: 1 = all from one side, 0 = from all around."""
    if center is None or not views:
        return 1.0
    toward = np.stack([view.camera.center for view in views]) - center
    return float(np.linalg.norm((toward / np.linalg.norm(toward, axis=1, keepdims=True)).mean(axis=0)))
