"""View-dependent residuals on spiral directions. Source: gong-yang, sec. 4.2.

For every direction of the spiral, parallel rays through the support rectangle find the nearest surface; its colour as
seen from that direction is blended from the best four photos, and the diffuse colour is subtracted. The result is then
refined on the training photos (`refine`).

Memory: the differences of all images, 12 bytes a texel, lie in scratch files (12 more where the encoding needs the
diffuse colours); photos are rendered in batches whose images fit `memory_mb`.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import Field

from ibrpipe.config import StageConfig
from ibrpipe.engine.executor import current_executor
from ibrpipe.engine.memory_map import hand_back, scratch_array
from ibrpipe.modelling.view_dependence.back_projection import errors_in_batches
from ibrpipe.modelling.view_dependence.sample_sets import Samples, in_batches
from ibrpipe.modelling.view_dependence.spiral_images import chunks, spiral_images
from ibrpipe.modelling.view_dependence.work_units import (
    Sources,
    context_of,
    forget_errors,
    project_errors,
    sample_images,
)
from ibrpipe.progress import track
from ibrpipe.types import Array

#: texels of a work unit, about; units that are sent ahead
UNIT, AHEAD = 200_000, 16


class ResidualsConfig(StageConfig):
    """Settings of the residuals stage."""

    encoding: Literal["8bit", "half"] = Field(
        "8bit", description="8bit: differences of sRGB codes around a zero offset; half: linear differences"
    )
    zero: int | Literal["auto"] = Field(
        "auto", description="Code of a residual of nothing (the paper takes 32); auto: from the residuals' own range"
    )
    quality: int = Field(
        90,
        ge=1,
        le=100,
        description="WebP quality of 8-bit residual images; 100 = lossless, about three times the bytes",
    )
    refine: int = Field(
        1,
        ge=0,
        le=5,
        description="Rounds of refinement on the training photos; 0 = as published, more than 1 follows their noise",
    )
    memory_mb: int = Field(
        500,
        ge=16,
        le=1_000_000,
        description="Memory for the residuals that the rendered training photos look up, megabytes; less means that "
        "images are read more often",
    )
    closed: bool = Field(True, description="Add the turn along the horizon that the published spiral leaves open")


def sample(sources: Sources, which: int, config: ResidualsConfig, scratch: Path | None = None) -> Samples:
    """Sample all directions of one texture, as published; into files of the folder `scratch` if there is one."""
    plan = context_of(sources).plans[which]
    images = spiral_images(plan, config.closed)[1]
    texels = sum(image.texels for image in images)

    def empty(name: str) -> Array:
        if scratch is None:
            return np.empty((texels, 3), np.float32)
        return scratch_array(scratch / f"{name}_{which:02d}.partial", texels)

    found = Samples(which, empty("difference"), empty("base") if config.encoding == "half" else None)
    runs, end = chunks(images, UNIT), 0
    done = in_order(sample_images, runs, sources, which, config.closed)
    for difference, base in track(done, f"residuals {plan.rectangle.name}", len(runs)):
        own = slice(end, end + len(difference))
        found.difference[own], end = difference, own.stop
        hand_back(found.difference)
        if found.base is not None:
            found.base[own] = base
            hand_back(found.base)
    return found


def in_order(unit: Callable[..., Any], runs: Sequence[tuple[int, int]], *common: object) -> Iterator[Any]:
    """Send units to the executor, some ahead of the one that is waited for, and yield what they find, in order."""
    pool, pending = current_executor(), deque[Any]()
    for run in runs:
        pending.append(pool.submit(unit, *common, *run))
        if len(pending) > AHEAD:
            yield pending.popleft().result()
    while pending:
        yield pending.popleft().result()


def refine(sources: Sources, samples: Sequence[Samples], scratch: Path, config: ResidualsConfig) -> list[float]:
    """Add the training photos' errors to all textures' samples in place, `config.refine` times.

    Returns
    -------
    list of float
        PSNR of the training photos in their masks, on exact geometry and before coding: before every round and at last.
    """
    context, found = context_of(sources), []
    for turn in range(config.refine + 1):
        batches = in_batches(context, samples, config.closed, config.memory_mb * 1_000_000)
        errors, psnr = errors_in_batches(context, batches)
        found.append(psnr)
        if turn == config.refine:
            return found
        np.save(scratch, errors)
        del errors
        for s in samples:
            plan = context.plans[s.which]
            runs, end = chunks(spiral_images(plan, config.closed)[1], UNIT), 0
            done = in_order(project_errors, runs, sources, scratch, s.which, config.closed)
            for correction in track(done, f"refinement {plan.rectangle.name}", len(runs)):
                own = slice(end, end + len(correction))
                s.difference[own] += correction
                end = own.stop
                hand_back(s.difference)
        forget_errors()
        scratch.unlink()
    return found
