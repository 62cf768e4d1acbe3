"""A flight over a forest: how much pictures change from frame to frame beyond what they must."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from ibrpipe.bench.forest.peer import Peer
from ibrpipe.bench.forest.pictures import our_picture, over_sky, peer_picture
from ibrpipe.bench.forest.results import FlightRow
from ibrpipe.core.color import srgb_encode
from ibrpipe.renderers.api import Prepared
from ibrpipe.renderers.hierarchical import drawing
from ibrpipe.renderers.hierarchical.data import HierarchicalData
from ibrpipe.renderers.hierarchical.options import HierarchicalOptions
from ibrpipe.renderers.hierarchical.selection import select
from ibrpipe.renderers.hierarchical.view import view_of
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
    cameras = flight_cameras(trees, frames, size)
    flown = [over_sky(*our_picture(ours, camera, "slices")) for camera in cameras]
    kept = [kept_picture(ours.data, *pair) for pair in pairwise(cameras)]
    if peer is None:
        truth = [over_sky(*our_picture(ours, camera, "polygons", samples=4)) for camera in cameras]
    else:
        truth = [peer_picture(peer, camera, _TRUTH) for camera in cameras]
    others = [] if peer is None else [peer_picture(peer, camera, _SIDE) for camera in cameras]
    one, without, other = (
        changes(before, after, truth) for before, after in ((flown, flown[1:]), (flown, kept), (others, others[1:]))
    )
    return FlightRow(
        trees=trees, frames=frames, ours_rms=one[0], ours_block=one[1], kept_rms=without[0], kept_block=without[1],
        peer_rms=None if peer is None else other[0], peer_block=None if peer is None else other[1],
    )  # fmt: skip


def kept_picture(data: HierarchicalData, before: Camera, after: Camera) -> Array:
    """Return the picture (H, W, 3) over the sky that one camera sees, of parts, resolutions and directions of another.

    Nothing switches on the way from `before` to `after`: no cross-fade can change less.
    """
    views = [view_of(camera, data.lighting, 1e-6 * data.radius) for camera in (before, after)]
    limits = views[0].limits(HierarchicalOptions().pixel_error)
    chosen = select(data.nodes, data.guide, np.array([data.nodes.root], np.int32), views[0].pose.reshape(1, 12), limits)
    moved = replace(
        chosen,
        slice_poses=_seen_from(chosen.slice_poses, before, after),
        polygon_poses=_seen_from(chosen.polygon_poses, before, after),
    )
    slices = drawing.place(data.library, data.shaded, data.guide.rows, moved, views[1])
    faces = drawing.set_up(data.nodes, data.guide.spheres, moved, views[1])
    color, alpha, _ = drawing.draw(slices, faces, data.shaded.texels, views[1], False)
    return over_sky(color * alpha[..., None], alpha)


def _seen_from(poses: Array, before: Camera, after: Camera) -> Array:
    """Poses (N, 12) in one camera's frame, in another's."""
    turn = after.R @ before.R.T
    shift = after.t - turn @ before.t
    moved = np.einsum("ij,njk->nik", turn, poses.reshape(-1, 3, 4))
    moved[:, :, 3] += shift
    return np.ascontiguousarray(moved.reshape(-1, 12))


def changes(before: Sequence[Array], after: Sequence[Array], truth: Sequence[Array]) -> tuple[float, float]:
    """Return how much the change from picture to picture differs from the truth's, in 8-bit codes of sRGB.

    Pictures (H, W, 3), linear: `truth` of all frames, `before` of all or all but the last, `after` from the second on.
    The first number is the root mean square over pixels, the second the largest mean over a block of `BLOCK` x `BLOCK`
    pixels.
    """
    total, count, most = 0.0, 0, 0.0
    for one, other, exact in zip(before, after, pairwise(truth)):
        error = [
            srgb_encode(a.astype(np.float64)) - srgb_encode(b.astype(np.float64)) for a, b in zip((one, other), exact)
        ]
        change = 255.0 * (error[1] - error[0])
        total, count = total + float((change**2).sum()), count + change.size
        rows, columns = (n // BLOCK * BLOCK for n in change.shape[:2])
        blocks = change[:rows, :columns].reshape(rows // BLOCK, BLOCK, columns // BLOCK, BLOCK, 3).mean(axis=(1, 3))
        most = max(most, float(np.abs(blocks).max(initial=0.0)))
    return math.sqrt(total / max(count, 1)), most
