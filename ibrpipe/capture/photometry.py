"""How exposure and white balance differ between photos, found from the surface that they show in common.

A point of matt surface has one colour, so what two photos say of the same points differs by one factor a channel. The
medians of those factors over pairs of photos give every photo's own, by least squares. On shiny surface colours differ
between photos, too, but from point to point, so that no factor brings them together: gains are only believed where they
explain much of what photos disagree by.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ibrpipe.capture.coverage import SurfacePoints
from ibrpipe.capture.photo_set import load_photo
from ibrpipe.core.color import luminance
from ibrpipe.embree import MeshCaster
from ibrpipe.io.views import View
from ibrpipe.progress import track
from ibrpipe.types import Array

#: points that two photos must show in common; pairs that every photo takes part in, those with most points
IN_COMMON, PARTNERS = 30, 16
#: light below and share of white above which a pixel tells nothing, and the least cosine to the normal
DARK, CLIPPED, COS_MIN = 0.01, 0.9, 0.4
#: stops that medians of even identical photos scatter by
NOISE = 0.02


@dataclass(frozen=True, eq=False)
class Gains:
    """Factors that bring photos to one exposure and white balance.

    Attributes
    ----------
    train : (P, 3) float64
        Of linear red, green and blue of every photo; their median over photos is 1.
    before, after : float
        Median disagreement of photos about points that three or more show, stops, without and with these factors;
        NaN where no points are.
    colors : (N, 3) float64
        log2 of the points' linear colours with the factors; NaN where no photo tells.
    """

    train: Array
    before: float
    after: float
    colors: Array

    @property
    def explained(self) -> float:
        """Share of the disagreement that the factors explain, 0 to 1."""
        return max(0.0, 1.0 - self.after / self.before) if self.before > 0 else 0.0

    @property
    def stops(self) -> float:
        """Root of the mean square of exposures, stops."""
        return float(np.sqrt((np.log2(luminance(self.train)) ** 2).mean()))


def observe(views: Sequence[View], caster: MeshCaster, points: SurfacePoints) -> Array:
    """Look up surface points in photos, one photo in memory at a time.

    Returns
    -------
    (N, P, 3) float32
        log2 of linear light; NaN where a photo does not see the point, or is too dark, clipped or oblique there.
    """
    found = np.full((len(points.position), len(views), 3), np.nan, np.float32)
    for number, view in enumerate(track(views, "photos in common")):
        toward = view.camera.center - points.position
        toward /= np.linalg.norm(toward, axis=1, keepdims=True)
        color, _ = load_photo(view, caster).blend(points.position, points.normal, toward)
        stored = color / view.factors
        with np.errstate(invalid="ignore"):
            told = (stored.min(axis=1) > DARK) & (stored.max(axis=1) < CLIPPED)
            told &= (toward * points.normal).sum(axis=1) >= COS_MIN
        found[told, number] = np.log2(color[told])
    return found


def find_gains(seen: Array) -> Gains:
    """Find the factors of photos from what they show of the same points.

    Parameters
    ----------
    seen : (N, P, 3) float32, as `observe` returns it

    Returns
    -------
    Gains
        Photos that share too little with any other keep the factor 1.
    """
    pairs = _pairs(np.isfinite(seen[:, :, 0]))
    stops = np.stack([_solve(seen[:, :, channel], pairs) for channel in range(3)], axis=1)
    balanced = seen - stops.astype(np.float32)
    often = np.isfinite(seen[:, :, 0]).sum(axis=1) >= 3
    return Gains(2.0**-stops, _disagreement(seen[often]), _disagreement(balanced[often]), _middle(balanced))


def gain_of(seen: Array, colors: Array) -> Array:
    """Find the factors (3,) of one photo that shows points (N, 3), as log2 of linear light, of known `colors` (N, 3).

    1 where it shows too few of them.
    """
    off = seen - colors
    off = off[np.isfinite(off).all(axis=1)]
    return 2.0 ** -np.median(off, axis=0) if len(off) >= IN_COMMON else np.ones(3)


def _pairs(seen: Array) -> Array:
    """Return pairs (M, 2) of photos that show enough in common, for every photo those that show most."""
    flags = seen.astype(np.float32)
    common = np.triu(flags.T @ flags, 1)
    common += common.T
    best = np.argsort(-common, axis=1, kind="stable")[:, :PARTNERS]
    found = {(min(p, q), max(p, q)) for p, row in enumerate(best.tolist()) for q in row if common[p, q] >= IN_COMMON}
    return np.array(sorted(found), np.int64).reshape(-1, 2)


def _solve(seen: Array, pairs: Array) -> Array:
    """Return stops (P,) by which one channel (N, P) of photos is too bright, their median 0, from pairs (M, 2)."""
    from scipy.sparse import csr_array
    from scipy.sparse.linalg import lsqr

    count = seen.shape[1]
    if not len(pairs):
        return np.zeros(count)
    apart, weight = np.empty(len(pairs)), np.empty(len(pairs))
    for row, (p, q) in enumerate(pairs):
        off = seen[:, p] - seen[:, q]
        off = off[np.isfinite(off)]
        apart[row] = np.median(off)
        weight[row] = np.sqrt(len(off)) / (np.median(np.abs(off - apart[row])) + NOISE)
    rows = np.repeat(np.arange(len(pairs)), 2)
    signs = np.tile([1.0, -1.0], len(pairs)) * np.repeat(weight, 2)
    matrix = csr_array((signs, (rows, pairs.ravel())), shape=(len(pairs), count))
    stops = lsqr(matrix, apart * weight, atol=1e-10, btol=1e-10)[0]  # of all solutions the shortest
    known = np.unique(pairs)
    stops[known] -= np.median(stops[known])
    return np.asarray(stops)


def _middle(seen: Array) -> Array:
    """Return the median over photos of (N, P, C); NaN where there is none."""
    import warnings

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # points that no photo tells of
        return np.asarray(np.nanmedian(seen, axis=1), np.float64)


def _disagreement(seen: Array) -> float:
    """Return the median of how far photos (N, P, 3) are from their own median, NaN where there are none."""
    off = np.abs(seen - _middle(seen)[:, None])
    return float(np.nanmedian(off)) if np.isfinite(off).any() else float("nan")
