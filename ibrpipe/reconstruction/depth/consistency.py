"""Which depths are kept: those that neighbours confirm, in pieces that are not tiny; and how sure they are."""

from __future__ import annotations

import time

import numpy as np

from ibrpipe.core.patchmatch.check import count_agreeing
from ibrpipe.core.patchmatch.planes import depths_and_normals
from ibrpipe.io.dense import write_map
from ibrpipe.reconstruction.depth.job import Job
from ibrpipe.reconstruction.depth.patchmatch import pixel_step, relation
from ibrpipe.types import Array

#: agreeing neighbours of a depth that is as sure as its correlation says
ENOUGH = 4
#: a piece ends where depth steps by more than this, pixels of motion
STEP = 2.0


def keep_agreed(job: Job, which: int, number: int) -> float:
    """Write the depth, normal and confidence map of a view from the planes of the last round; return the seconds."""
    start = time.perf_counter()
    name, space = job.views[which].name, job.workspace
    selection, config = job.selections[which], job.config
    reference = job.picture(which, 1)
    pictures = [job.picture(other, 1) for other in selection.others]
    views = np.stack([relation(reference.camera, each.camera) for each in pictures])
    state = job.planes(number, which, 4)
    length = max(each.valid.size for each in pictures)
    others = np.zeros((len(pictures), 3, length), np.float32)
    for n, other in enumerate(selection.others):
        planes = job.planes(number, other)
        others[n, :, : planes[0].size] = planes.reshape(3, -1)
    count = np.zeros(reference.valid.shape, np.uint8)
    # where texture is weak, normals of a mere pair are noise
    angle = config.max_normal_angle if len(pictures) > 1 else 180.0
    limits = np.array([config.max_shift, config.max_depth_change, np.cos(np.radians(angle))])
    count_agreeing(reference.lens, limits, views, others, state, count)
    kept = (state[0] > 0) & (count >= min(config.min_agreeing, len(pictures)))
    step = pixel_step(reference.camera, views, float(0.5 / selection.near + 0.5 / selection.far))
    kept &= ~small_pieces(np.where(kept, state[0], 0), STEP * step, config.min_segment)
    sure = np.clip(1 - state[3], 0, 1) * np.minimum(count / np.float32(ENOUGH), 1)
    depth, normal = np.empty(kept.shape, np.float32), np.empty((*kept.shape, 3), np.float32)
    state[0] *= kept
    depths_and_normals(reference.lens, state, depth, normal)
    write_map(space.normal(name), normal)
    write_map(space.confidence(name), np.where(kept, sure, 0).astype(np.float32))
    write_map(space.depth(name), depth)
    return time.perf_counter() - start


def small_pieces(inverse: Array, step: float, least: int) -> Array:
    """Which known pixels (inverse depth above 0) belong to connected pieces of fewer than `least` pixels, (H, W) bool.

    Neighbouring pixels are connected where their inverse depths differ by at most `step`.
    """
    import cv2

    codes = np.clip(inverse / step * 16, 0, None)
    codes = np.where(inverse > 0, np.minimum(codes - codes.min(initial=0, where=inverse > 0) + 1, 32000), 0)
    before = codes.astype(np.int16)
    after = before.copy()
    cv2.filterSpeckles(after, 0, max(least - 1, 0), 16)
    return (before > 0) & (after == 0)
