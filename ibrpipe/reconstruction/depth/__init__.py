"""Depth maps of all views of a capture, by PatchMatch or by rectified pairs, in COLMAP's layout."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from pathlib import Path
from typing import Any

from ibrpipe.engine.executor import current_executor
from ibrpipe.errors import CaptureError
from ibrpipe.io.dense import DepthMap, read_map, write_workspace
from ibrpipe.io.points import SparsePoints
from ibrpipe.io.views import View
from ibrpipe.progress import Part, Step
from ibrpipe.reconstruction.depth.consistency import keep_agreed
from ibrpipe.reconstruction.depth.image_pyramid import forget_pictures
from ibrpipe.reconstruction.depth.job import Job
from ibrpipe.reconstruction.depth.patchmatch import run_pass
from ibrpipe.reconstruction.depth.schedule import Pass, megapixels, rounds_of
from ibrpipe.reconstruction.depth.semi_global import run_pairs
from ibrpipe.reconstruction.depth.settings import DepthConfig
from ibrpipe.reconstruction.depth.spacing import angles_between
from ibrpipe.reconstruction.depth.view_selection import select_views

__all__ = ["DepthConfig", "depth_parts", "estimate_depths"]

#: what a sweep by the photos alone costs, a sweep by the neighbours' depth too, reading and preparing, and a pair of
#: photos: as a step's cost, for a million pixels of maps
SWEEP, CONSISTENT, PREPARE, PAIR = 1.75, 2.3, 0.3, 0.1
AGREEMENT = Step("depth maps", 0.3)


def depth_parts(views: Sequence[View], config: DepthConfig) -> list[Part]:
    """Return the loops of the estimation, with what they cost."""
    agreement = AGREEMENT.part(megapixels(views, config.max_size, 1))
    if config.method == "sgbm":
        return [_pairs(config).part(megapixels(views, config.max_size, 1)), agreement]
    rounds = rounds_of([view.camera for view in views], config)
    parts = [_round(each, rounds).part(megapixels(views, config.max_size, each.shrink)) for each in rounds]
    return [*parts, agreement]


def _round(order: Pass, rounds: Sequence[Pass]) -> Step:
    sweep = CONSISTENT if order.consistent else SWEEP
    return Step(f"depth {order.number + 1}/{len(rounds)}", PREPARE + order.sweeps * sweep)


def _pairs(config: DepthConfig) -> Step:
    return Step("depth by pairs", PREPARE + PAIR * config.pairs)


def estimate_depths(
    views: Sequence[View], workspace: Path, config: DepthConfig, seed: int, points: SparsePoints | None
) -> tuple[DepthMap, ...]:
    """Estimate depth, normals and confidence of every view.

    Parameters
    ----------
    views : sequence of View
        At least two.
    workspace : Path
        Folder to fill; a run that was stopped goes on where it was when the same is asked again.
    config : DepthConfig
    seed : int
    points : SparsePoints or None
        Its views are indices of `views`; they choose neighbours and depth ranges. None: cameras and masks do.

    Returns
    -------
    tuple of DepthMap
        In the order of `views`. Depth 0 is unknown.

    Raises
    ------
    CaptureError
        There are fewer than two views, or one shares nothing with the others.

    Notes
    -----
    Memory: ``20 V + 80`` bytes a pixel of a depth map for V neighbours and each unit at work, and a cache of pictures
    of `pictures.CACHE_BYTES`. Disk, until it is done: 32 bytes a pixel of all depth maps.
    """
    selections = select_views(views, points, config.neighbours)
    job = Job(tuple(views), selections, config, seed, workspace)
    job.resume()
    method = _by_planes if config.method == "patchmatch" else _by_pairs
    seconds = [0.0] * len(views) if job.done() else method(job)
    maps = tuple(
        DepthMap(
            view, job.workspace.depth(view.name), job.workspace.normal(view.name), job.workspace.confidence(view.name),
            tuple(views[other].name for other in selection.others), seconds[i],
            angles_between(view, [views[other] for other in selection.others], read_map(job.workspace.depth(view.name)),
                           2 / (1 / selection.near + 1 / selection.far)),
        )
        for i, (view, selection) in enumerate(zip(views, selections, strict=True))
    )  # fmt: skip
    write_workspace(job.workspace, maps)
    job.finish()
    return maps


def _by_planes(job: Job) -> list[float]:
    """Run all rounds over all views, then write what is kept; return the seconds of each view."""
    rounds = rounds_of([view.camera for view in job.views], job.config)
    seconds = [0.0] * len(job.views)
    first = 1 + max((order.number for order in rounds if job.whole(order.number)), default=-1)
    for order in rounds[first:]:
        for i, work in enumerate(_round(order, rounds).track(_submitted(run_pass, job, order))):
            seconds[i] += work.result()
        if order.number > 0:
            shutil.rmtree(job.state_file(order.number - 1, 0).parent, ignore_errors=True)
    return _agreed(job, seconds, rounds[-1].number)


def _by_pairs(job: Job) -> list[float]:
    """Match all views by rectified pairs, then write what is kept; return the seconds of each view."""
    seconds = [work.result() for work in _pairs(job.config).track(_submitted(run_pairs, job))]
    if not any((job.planes(0, which, 1) > 0).any() for which in range(len(job.views))):
        raise CaptureError(
            "no photo can be rectified with a neighbour, or none of the pairs match: the camera moved along its "
            "view or turned too far; use geometry.depth.method=patchmatch"
        )
    return _agreed(job, seconds, 0)


def _agreed(job: Job, seconds: list[float], number: int) -> list[float]:
    after = [work.result() for work in AGREEMENT.track(_submitted(keep_agreed, job, number))]
    forget_pictures()
    return [one + other for one, other in zip(seconds, after, strict=True)]


def _submitted(unit: Callable[..., float], job: Job, *extra: Any) -> list[Future[float]]:
    pool = current_executor()
    return [pool.submit(unit, job, i, *extra) for i in range(len(job.views))]
