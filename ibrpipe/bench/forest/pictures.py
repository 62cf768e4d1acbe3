"""Pictures of forests, by us and by the peer, over a plain sky."""

from __future__ import annotations

from typing import Any

import numpy as np

from ibrpipe.bench.forest.peer import Peer
from ibrpipe.renderers.api import Prepared, render
from ibrpipe.types import Array, Camera

#: linear light of the sky that pictures are compared over
SKY = (0.55, 0.70, 0.90)


def our_picture(ours: Prepared, camera: Camera, mode: str, **options: Any) -> tuple[Array, Array]:
    """Return premultiplied colour (H, W, 3) and coverage (H, W)."""
    frame = render(ours, camera, "hierarchical", ("color", "alpha"), mode=mode, **options)
    assert frame.color is not None
    assert frame.alpha is not None
    return frame.color * frame.alpha[..., None], frame.alpha


def peer_picture(peer: Peer, camera: Camera, side: int) -> Array:
    """Return the peer's picture (H, W, 3) over the sky, side x side samples a pixel."""
    picture, _ = peer.render(camera, side)
    return over_sky(picture[..., :3], picture[..., 3])


def over_sky(color: Array, alpha: Array) -> Array:
    """Return a picture (H, W, 3) over the sky; `color` premultiplied."""
    return color + (1.0 - alpha[..., None]) * np.array(SKY, np.float32)
