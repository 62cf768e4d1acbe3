"""A flight over a forest: how much pictures change from frame to frame beyond what they must."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

from ibrpipe.bench.forest.peer import Peer
from ibrpipe.bench.forest.pictures import our_picture, over_sky, peer_picture
from ibrpipe.bench.forest.results import FlightRow
from ibrpipe.core.color import srgb_encode
from ibrpipe.renderers.api import Prepared
from ibrpipe.synthetic.instanced.forest import forest_cameras
from ibrpipe.types import Array, Camera

#: pixels along a side of a block whose mean change is told
BLOCK = 16
#: samples along a side of a pixel: the peer's that is compared, and the truth's
_SIDE, _TRUTH = 2, 8
#: share of the way from far to middle at which a flight begins, and that it makes in a frame
_BEGIN, _STEP = 0.4, 0.003


def flight_cameras(trees: int, frames: int, size: tuple[int, int]) -> list[Camera]:
    """Cameras on the way from the far view to the middle one, about a pixel of motion a frame."""
    views = forest_cameras(trees, *size)
    far, near = (views[name] for name in ("far", "middle"))
    ahead = [camera.center + camera.R[2] * float(np.linalg.norm(camera.center)) for camera in (far, near)]
    found = []
    for n in range(frames):
        t = _BEGIN + _STEP * n
        eye, at = ((1 - t) * a + t * b for a, b in ((far.center, near.center), (ahead[0], ahead[1])))
        found.append(Camera.look_at(eye, at, fov_y_deg=47.0, width=size[0], height=size[1]))
    return found


def fly(trees: int, frames: int, ours: Prepared, peer: Peer | None, size: tuple[int, int]) -> FlightRow:
    """Measure a flight of some frames; without the peer, truth is our polygons at 4 x 16 samples a pixel."""
    shown: dict[str, list[Array]] = {"ours": [], "peer": [], "truth": []}
    for camera in flight_cameras(trees, frames, size):
        shown["ours"].append(over_sky(*our_picture(ours, camera, "slices")))
        if peer is None:
            shown["truth"].append(over_sky(*our_picture(ours, camera, "polygons", samples=4)))
        else:
            shown["peer"].append(peer_picture(peer, camera, _SIDE))
            shown["truth"].append(peer_picture(peer, camera, _TRUTH))
    one, other = (changes(shown[name], shown["truth"]) for name in ("ours", "peer"))
    return FlightRow(
        trees=trees, frames=frames, ours_rms=one[0], ours_block=one[1],
        peer_rms=None if peer is None else other[0], peer_block=None if peer is None else other[1],
    )  # fmt: skip


def changes(pictures: list[Array], truth: list[Array]) -> tuple[float, float]:
    """Return how much the change from picture to picture differs from the truth's, in 8-bit codes of sRGB.

    Pictures (H, W, 3), linear. The first number is the root mean square over pixels, the second the largest mean
    over a block of `BLOCK` x `BLOCK` pixels.
    """
    total, count, most = 0.0, 0, 0.0
    errors = [srgb_encode(a.astype(np.float64)) - srgb_encode(b.astype(np.float64)) for a, b in zip(pictures, truth)]
    for before, after in pairwise(errors):
        change = 255.0 * (after - before)
        total, count = total + float((change**2).sum()), count + change.size
        rows, columns = (n // BLOCK * BLOCK for n in change.shape[:2])
        blocks = change[:rows, :columns].reshape(rows // BLOCK, BLOCK, columns // BLOCK, BLOCK, 3).mean(axis=(1, 3))
        most = max(most, float(np.abs(blocks).max(initial=0.0)))
    return math.sqrt(total / max(count, 1)), most
