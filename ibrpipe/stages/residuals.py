"""View-dependent residuals on spiral directions. Source: gong-yang, sec. 4.2.

For every direction of the spiral, parallel rays through the support rectangle find the nearest surface; its colour as
seen from that direction is blended from the best four photos, and the diffuse colour is subtracted. The result is then
refined on the training photos (`refine`).

Memory: 12 bytes a texel of all images for the differences, 12 more where the encoding needs the diffuse colours, and 16
more while they are refined.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import Field

from ibrpipe.config import StageConfig
from ibrpipe.core.color import srgb_decode, srgb_encode
from ibrpipe.io.residuals import write_residuals
from ibrpipe.progress import track
from ibrpipe.stages.executor import current_executor
from ibrpipe.stages.plan import TexturePlan, read_plan
from ibrpipe.stages.refine import photo_errors
from ibrpipe.stages.residual_units import Context, Sources, context_of, forget, project_errors, sample_images
from ibrpipe.stages.spiral_images import chunks, spiral_images
from ibrpipe.stages.stage import Stage
from ibrpipe.types import Array, SpiralResiduals, SpiralTexture

#: texels of a work unit, about
UNIT = 200_000
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


@dataclass(eq=False)
class Samples:
    """Residuals of one texture before they are coded.

    Attributes
    ----------
    which : index of the texture in the plan
    difference : (T, 3) float32, colour minus diffuse colour in display code (1 = white); NaN = none
    base : (T, 3) float32, diffuse colour, linear; None where the encoding does without
    """

    which: int
    difference: Array
    base: Array | None

    @property
    def valid(self) -> Array:
        """(T,) bool, texels that hold a residual."""
        return np.asarray(np.isfinite(self.difference).all(axis=1))


def sample(sources: Sources, which: int, config: ResidualsConfig) -> Samples:
    """Sample all directions of one texture, as published."""
    plan = context_of(sources).plans[which]
    pool = current_executor()
    runs = chunks(spiral_images(plan, config.closed)[1], UNIT)
    pending = [pool.submit(sample_images, sources, which, config.closed, *run) for run in runs]
    found = [work.result() for work in track(pending, f"residuals {plan.rectangle.name}")]
    base = np.concatenate([part[1] for part in found]) if config.encoding == "half" else None
    return Samples(which, np.concatenate([part[0] for part in found]), base)


def refine(sources: Sources, samples: Sequence[Samples], scratch: Path, config: ResidualsConfig) -> list[float]:
    """Add the training photos' errors to all textures' samples in place, `config.refine` times.

    Returns
    -------
    list of float
        PSNR of the training photos in their masks, on exact geometry and before coding: before every round and at last.
    """
    context, pool, found = context_of(sources), current_executor(), []
    for turn in range(config.refine + 1):
        textures = [SpiralTexture(context.layers[s.which], uncoded(context, s, config.closed)) for s in samples]
        errors, psnr = photo_errors(context, textures)
        found.append(psnr)
        if turn == config.refine:
            return found
        np.save(scratch, errors)
        for s in samples:
            plan = context.plans[s.which]
            runs = chunks(spiral_images(plan, config.closed)[1], UNIT)
            pending = [pool.submit(project_errors, sources, scratch, s.which, config.closed, *run) for run in runs]
            done = [work.result() for work in track(pending, f"refinement {plan.rectangle.name}")]
            s.difference += np.concatenate(done)
        scratch.unlink()
    return found


def uncoded(context: Context, samples: Samples, closed: bool) -> SpiralResiduals:
    """Residuals as they are before coding: texels float32 in 255ths of the display code, `zero` 0."""
    texels = np.float32(255) * np.where(samples.valid[:, None], samples.difference, np.float32(0))
    return assemble(context.plans[samples.which], closed, texels, samples.valid, 0)


def assemble(plan: TexturePlan, closed: bool, texels: Array, valid: Array, zero: int) -> SpiralResiduals:
    """Put texels (T, 3) uint8 or float32 and the geometry of their images together."""
    alphas, images = spiral_images(plan, closed)
    sizes = np.array([(image.height, image.width) for image in images], np.int32)
    starts = np.concatenate([[0], np.cumsum(sizes.astype(np.int64).prod(axis=1))])
    directions = np.stack([image.direction for image in images])
    return SpiralResiduals(plan.rectangle.edges, plan.k, alphas, directions, sizes, starts, texels, valid, zero, closed)


def code(samples: Samples, config: ResidualsConfig) -> tuple[Array, Array, int, int]:
    """Code differences; return texels (T, 3), valid (T,), zero offset and how many valid texels were clamped."""
    valid = samples.valid
    if samples.base is not None:
        base, difference = samples.base[valid], samples.difference[valid]
        texels = np.zeros(samples.difference.shape, np.float32)
        texels[valid] = (srgb_decode(srgb_encode(base, np.inf) + difference) - base).astype(np.float16)
        return texels, valid, 0, 0
    steps = np.zeros(samples.difference.shape, np.float32)
    steps[valid] = np.round(255 * samples.difference[valid])
    zero = choose_zero(steps[valid]) if config.zero == "auto" else config.zero
    shifted = steps + zero
    clamped = ((shifted < 0) | (shifted > 255)).any(axis=1) & valid
    return np.clip(shifted, 0, 255).astype(np.uint8), valid, zero, int(clamped.sum())


def choose_zero(difference: Array) -> int:
    """Zero offset that clamps fewest values of whole-number differences (V, 3); 32 where nothing clamps."""
    if difference.size == 0:
        return 32
    counts = np.bincount(np.clip(difference, -255, 255).astype(np.int64).ravel() + 255, minlength=511)
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
        samples = [sample(sources, which, config) for which in wanted]
        psnr = refine(sources, samples, inputs.out / ERRORS, config) if samples else []
    finally:
        forget()
    written = [write_texture(plans[s.which], s, inputs.out, config) for s in samples]
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
