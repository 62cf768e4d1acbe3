"""One round of PatchMatch over one view: a work unit that reads its data from files and writes its planes."""

from __future__ import annotations

import time
from collections.abc import Sequence

import numpy as np

from ibrpipe.core.patchmatch.cost import LANES
from ibrpipe.core.patchmatch.planes import random_planes
from ibrpipe.core.patchmatch.sweep import sweep
from ibrpipe.core.patchmatch.views import ROW
from ibrpipe.reconstruction.depth.image_pyramid import Picture
from ibrpipe.reconstruction.depth.job import Job, store
from ibrpipe.reconstruction.depth.schedule import Pass, enlarged
from ibrpipe.reconstruction.depth.view_selection import ViewSelection
from ibrpipe.types import Array, Camera

#: pixels of disagreement between depth maps that cost most
MOST = 2.0


def run_pass(job: Job, which: int, order: Pass) -> float:
    """Sweep over a view and store its planes; return the seconds it took, 0 where they were there already."""
    target = job.state_file(order.number, which)
    if target.is_file():
        return 0.0
    start = time.perf_counter()
    selection = job.selections[which]
    reference = job.picture(which, order.shrink)
    pictures = [job.picture(other, order.shrink) for other in selection.others]
    seed = job.seed * 1_000_003 + which
    state, others = first_state(reference, selection, seed), np.zeros((len(pictures), 1), np.float32)
    if order.number > 0:
        state = _continued(job.planes(order.number - 1, which, 4), reference)
        if order.consistent:
            others = _inverse_depths(job, order, selection, pictures)
    match(reference, pictures, others, selection, order, job, seed, state)
    store(target, state)
    return time.perf_counter() - start


def first_state(reference: Picture, selection: ViewSelection, seed: int) -> Array:
    """Random planes within the depth range, (4, H, W) float32."""
    state = np.empty((4, *reference.valid.shape), np.float32)
    random_planes(reference.lens, reference.valid, 1.0 / selection.far, 1.0 / selection.near, seed, state)
    return state


def match(
    reference: Picture,
    pictures: Sequence[Picture],
    others: Array,
    selection: ViewSelection,
    order: Pass,
    job: Job,
    seed: int,
    state: Array,
) -> None:
    """Run the sweeps of a round on `state` in place; `others` (V, N): the neighbours' inverse depth, row after row."""
    views = np.stack([relation(reference.camera, each.camera) for each in pictures]).astype(np.float32)
    window = disc()
    margin = int(np.abs(window[:2]).max())
    padded = np.pad(np.where(reference.valid > 0, reference.grey, np.float32(-1)), margin, constant_values=-1)
    low, high = 1.0 / selection.far, 1.0 / selection.near
    ranges = np.array([low, high, pixel_step(reference.camera, views, (low + high) / 2)])
    config = job.config
    softness = np.float32(1.0 / (32.0 * config.sigma**2))
    consistency = np.array([config.consistency if order.consistent else 0.0, MOST], np.float32)
    words = joined([each.words for each in pictures])
    for k in range(order.sweeps):
        for colour in (0, 1):
            step = colour, order.sweep_number + k, seed, order.reach * 0.6**k, config.keep
            sweep(
                step, softness, consistency, ranges, reference.lens, window, padded, reference.valid,
                (views, words, others), state,
            )  # fmt: skip


def relation(reference: Camera, other: Camera) -> Array:
    """How pixels of `reference` and `other` belong together, (32,) float64: see `core.patchmatch_views`."""
    row = np.zeros(ROW)
    for first, (here, there) in ((0, (reference, other)), (16, (other, reference))):
        rotation = there.R @ here.R.T
        row[first : first + 9] = (there.K @ rotation @ here.cam_from_pixel).ravel()
        row[first + 9 : first + 12] = there.K @ (there.t - rotation @ here.t)
    row[12:15] = other.width, other.height, other.width
    return row


def disc() -> Array:
    """Window of the LANES nearest pixels around a pixel: dx, dy, exponent / 16 of the distance, (3, LANES) float32."""
    reach = range(-8, 9)
    near = sorted((dx * dx + dy * dy, dy, dx) for dy in reach for dx in reach)[:LANES]
    square, dy, dx = np.array(near, np.float32).T
    return np.stack([dx, dy, square / (32.0 * max(float(np.abs(dx).max()), 1.0) ** 2)]).astype(np.float32)


def pixel_step(camera: Camera, views: Array, q: float) -> float:
    """Change of inverse depth that moves the middle of the picture by a pixel in the median neighbour."""
    middle = np.array([camera.width / 2, camera.height / 2, 1.0])
    ends = []
    for at in (q, q * 1.001):
        pixels = views[:, :9].reshape(-1, 3, 3).astype(np.float64) @ middle + views[:, 9:12].astype(np.float64) * at
        ends.append(pixels[:, :2] / pixels[:, 2:])
    motion = np.linalg.norm(ends[1] - ends[0], axis=1) / (0.001 * q)
    return float(1.0 / max(np.median(motion), 1e-9))


def joined(rows: Sequence[Array]) -> Array:
    """Rows of different lengths as one array, filled up with zeros."""
    out = np.zeros((len(rows), max(row.shape[-1] for row in rows)), rows[0].dtype)
    for n, row in enumerate(rows):
        out[n, : row.shape[-1]] = row
    return out


def _continued(state: Array, reference: Picture) -> Array:
    return state if state.shape[1:] == reference.valid.shape else enlarged(state, reference.valid)


def _inverse_depths(job: Job, order: Pass, selection: ViewSelection, pictures: Sequence[Picture]) -> Array:
    found = []
    for other, picture in zip(selection.others, pictures, strict=True):
        planes = job.planes(order.number - 1, other)
        if planes.shape[1:] != picture.valid.shape:
            planes = enlarged(np.concatenate([planes, planes[:1]]), picture.valid)
        found.append(planes[0].ravel())
    return joined(found)
