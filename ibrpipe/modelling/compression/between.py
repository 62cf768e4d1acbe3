"""How much better views between kept photos are shown than photos that are left out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ibrpipe.modelling.compression.parts import Measure
from ibrpipe.modelling.trial import STEEPEST, spread
from ibrpipe.types import Asset, KeptPhotos, PhotoBlend, Texture

#: one photo of so many is left where angles between photos are to double; photos that must then be left
THIN, LEAST = 4, 3


def between_photos(asset: Asset, measure: Measure) -> float:
    """Return by how many dB views between photos are expected to be shown better than photos predicted by the others.

    A photo that is left out lies twice as far from the next one as a view between photos. What that costs is told by
    photos of which only a quarter is left: angles double once more. 0 where an asset keeps no photos.
    """
    kept = asset.shared.get(PhotoBlend.kind)
    if not isinstance(kept, KeptPhotos) or len(kept.photos) < LEAST * THIN:
        return 0.0
    centers = np.stack([photo.camera.center for photo in kept.photos])
    chosen = spread(centers - centers.mean(axis=0), len(kept.photos) // THIN)
    few = PhotoBlend(replace(kept, photos=tuple(kept.photos[number] for number in chosen)))
    thin = Asset(
        tuple(
            Texture(each.layers, tuple(few if part.kind == few.kind else part for part in each.components))
            for each in asset.textures
        ),
        asset.info,
    )
    near, far = measure(asset), measure(thin)
    return 0.0 if near is None or far is None else float(np.clip(near - far, 0.0, STEEPEST))
