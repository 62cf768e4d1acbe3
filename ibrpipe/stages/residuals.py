"""View-dependent residuals on spiral directions. Source: gong-yang, sec. 4.2.

For every direction of the spiral, parallel rays through the support rectangle find the nearest surface; its colour as
seen from that direction is blended from the best four photos, and the diffuse colour is subtracted. The result is then
refined on the training photos (`refine`).

Memory: the differences of all images, 12 bytes a texel, lie in scratch files (12 more where the encoding needs the
diffuse colours); photos are rendered in batches whose images fit `memory_mb`.
"""

from __future__ import annotations

import json
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import Field

from ibrpipe.config import StageConfig
from ibrpipe.core.color import srgb_decode, srgb_encode
from ibrpipe.engine.executor import current_executor
from ibrpipe.engine.memory_map import hand_back, scratch_array
from ibrpipe.engine.stage import Stage
from ibrpipe.io.residuals import write_residuals
from ibrpipe.progress import track
from ibrpipe.stages.plan import TexturePlan, read_plan
from ibrpipe.stages.refine import errors_in_batches
from ibrpipe.stages.residual_sets import Samples, assemble, in_batches
from ibrpipe.stages.residual_units import Sources, context_of, forget, forget_errors, project_errors, sample_images
from ibrpipe.stages.spiral_images import chunks, spiral_images
from ibrpipe.types import Array

#: texels of a work unit, about; units that are sent ahead
UNIT, AHEAD = 200_000, 16
ERRORS = "errors.partial.npy"


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


@dataclass(frozen=True)
class Inputs:
    """What the residuals stage reads, and the folder that it fills."""

    views: Path
    mesh: Path
    plan: Path
    layers: Path
    out: Path


@dataclass(frozen=True)
class Outputs:
    """`residuals.json` and one file per texture that has residuals."""

    summary: Path
    files: tuple[Path, ...]


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


def code(samples: Samples, config: ResidualsConfig) -> tuple[Array, Array, int, int]:
    """Code differences; return texels (T, 3), valid (T,), zero offset and how many valid texels were clamped."""
    count = len(samples.difference)
    runs = [slice(start, min(start + UNIT, count)) for start in range(0, count, UNIT)]
    valid, clamped = np.empty(count, bool), 0
    if samples.base is not None:
        texels = np.zeros((count, 3), np.float32)
        for run in runs:
            part = Samples(samples.which, samples.difference[run], samples.base[run])
            valid[run], texels[run] = part.valid, _linear(part)
            hand_back(samples.difference)
            hand_back(samples.base)
        return texels, valid, 0, 0
    zero = _best_zero(samples, runs) if config.zero == "auto" else config.zero
    codes = np.empty((count, 3), np.uint8)
    for run in runs:
        steps, valid[run] = _steps(samples.difference[run])
        shifted = steps + zero
        clamped += int((((shifted < 0) | (shifted > 255)).any(axis=1) & valid[run]).sum())
        codes[run] = np.clip(shifted, 0, 255).astype(np.uint8)
        hand_back(samples.difference)
    return codes, valid, zero, clamped


def _linear(samples: Samples) -> Array:
    """Differences of linear light (T, 3) float32, rounded to half floats; 0 where there are none."""
    valid, texels = samples.valid, np.zeros(samples.difference.shape, np.float32)
    base = np.asarray(samples.base)[valid]
    texels[valid] = (srgb_decode(srgb_encode(base, np.inf) + samples.difference[valid]) - base).astype(np.float16)
    return texels


def _steps(difference: Array) -> tuple[Array, Array]:
    """Differences in whole 255ths (T, 3) float32, 0 where there are none, and where there are some (T,)."""
    valid = np.asarray(np.isfinite(difference).all(axis=1))
    steps = np.zeros(difference.shape, np.float32)
    steps[valid] = np.round(255 * np.asarray(difference[valid]))
    return steps, valid


def _best_zero(samples: Samples, runs: Sequence[slice]) -> int:
    """Zero offset that clamps fewest values; 32 where nothing clamps."""
    counts = np.zeros(511, np.int64)
    for run in runs:
        steps, valid = _steps(samples.difference[run])
        counts += np.bincount(np.clip(steps[valid], -255, 255).astype(np.int64).ravel() + 255, minlength=511)
        hand_back(samples.difference)
    inside = [counts[255 - zero : 511 - zero].sum() for zero in range(256)]
    best = max(inside)
    return 32 if inside[32] == best else int(np.argmax(inside))


def write_texture(
    plan: TexturePlan, samples: Samples, out: Path, config: ResidualsConfig
) -> tuple[Path, dict[str, Any]]:
    """Code and write one texture's residuals; return the file and its figures for `residuals.json`."""
    texels, valid, zero, clamped = code(samples, config)
    residuals = assemble(plan, config.closed, texels, valid, zero)
    folder = out / f"texture_{samples.which:02d}"
    folder.mkdir(parents=True, exist_ok=True)
    path = write_residuals(residuals, folder, config.quality)
    figures = {
        "name": plan.rectangle.name,
        "directions": len(residuals.alphas),
        "texels": len(valid),
        "valid_share": float(valid.mean()),
        "clamped_texels": clamped,
        "clamped_share": float(clamped / max(valid.sum(), 1)),
        "zero": zero,
        "encoding": config.encoding,
        "texture": samples.which,
        "bytes": path.stat().st_size,
    }
    return path, figures


def run(inputs: Inputs, config: ResidualsConfig) -> Outputs:
    """Sample residuals for every texture that the plan wants them for, and refine them all together.

    Raises
    ------
    CaptureError, FormatError
        The views, the mesh, the plan or the layers cannot be read.
    """
    sources = Sources(inputs.views, inputs.mesh, inputs.plan, inputs.layers)
    plans = read_plan(inputs.plan)
    wanted = [i for i, plan in enumerate(plans) if plan.residuals]
    try:
        samples = [sample(sources, which, config, inputs.out) for which in wanted]
        psnr = refine(sources, samples, inputs.out / ERRORS, config) if samples else []
    finally:
        forget()
    written = [write_texture(plans[s.which], s, inputs.out, config) for s in samples]
    samples.clear()  # some systems do not remove files that are mapped
    for leftover in inputs.out.glob("*.partial"):
        leftover.unlink()
    summary = inputs.out / "residuals.json"
    content = {"textures": [figures for _, figures in written], "training_psnr": [round(value, 3) for value in psnr]}
    summary.write_text(json.dumps(content, indent=1), encoding="utf-8")
    return Outputs(summary, tuple(path for path, _ in written))


STAGE = Stage(
    name="residuals",
    summary="Sample view-dependent residuals along the spiral directions of every texture that needs them.",
    inputs=Inputs,
    config=ResidualsConfig,
    run=run,
    needs=("ingest", "geometry", "plan", "layers"),
    example="ibrpipe residuals --views out/ingest/views.json --mesh out/geometry/mesh.ply --plan out/plan/plan.json "
    "--layers out/layers --out out",
)
