"""View dependence over pictures of maps: hits of samples become hits of the patches that have them."""

from __future__ import annotations

from typing import Any

import numpy as np

from ibrpipe.renderers.fields import Field, PatchField
from ibrpipe.renderers.scene import Hits, Scene
from ibrpipe.renderers.view_dependence.component import Picture
from ibrpipe.types import Array, Camera, LayeredDepthImage

#: number of a hit of nothing
NOTHING = 2**32 - 1


def add_components(scene: Scene, camera: Camera, hits: Hits, color: Array, known: Array) -> dict[str, Any]:
    """Add all components of a scene to a picture in place, whose hits are those of patches; return their figures."""
    stats: dict[str, Any] = {}
    for component in scene.components:
        stats.update(component.add(Picture(scene, camera, color, hits.depth, hits.ids, known)))
    return stats


def number_samples(field: Field, first: int, source: Any, size: int) -> Array:
    """Return a patch of every sample of a first layer that is laid out row by row with a rim of one texel.

    Of the up to four patches of a sample it is the one of which the sample is the first corner, if there is one.

    Parameters
    ----------
    first : int
        Number of the field's first patch.
    source : LayeredDepthImage, or any that has no view dependence
    size : int
        Texels laid out.

    Returns
    -------
    (size,) uint32; `NOTHING` where there is no sample, and for all sources without view dependence
    """
    out = np.full(size, NOTHING, np.uint32)
    if not (isinstance(field, PatchField) and isinstance(source, LayeredDepthImage)):
        return out
    patch = np.full(len(source.depth), NOTHING, np.uint32)
    for corner in (3, 2, 1, 0):
        some = np.flatnonzero(field.samples[:, corner] >= 0)
        patch[field.samples[some, corner]] = first + some
    row, column = np.nonzero(np.diff(source.offsets, axis=1) > 0)
    out[(row + 1) * (source.shape[1] + 2) + column + 1] = patch[source.offsets[row, column]]
    return out
