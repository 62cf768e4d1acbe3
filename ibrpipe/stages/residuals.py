"""View-dependent residuals on spiral directions. Source: gong-yang, sec. 4.2.

For every direction of the spiral, parallel rays through the support rectangle find the nearest surface; its colour as
seen from that direction is blended from the best four photos, and the diffuse colour is subtracted.
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
from ibrpipe.core import spiral
from ibrpipe.core.color import srgb_encode
from ibrpipe.embree import MeshCaster
from ibrpipe.io.layers import read_layers
from ibrpipe.io.meshes import read_mesh
from ibrpipe.io.residuals import write_residuals
from ibrpipe.io.views import read_views
from ibrpipe.progress import track
from ibrpipe.stages.diffuse import DiffuseSource
from ibrpipe.stages.executor import current_executor
from ibrpipe.stages.photos import PhotoSet, load_photos
from ibrpipe.stages.plan import TexturePlan, read_plan
from ibrpipe.stages.stage import Stage
from ibrpipe.types import Array, SpiralResiduals


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


@dataclass(frozen=True, eq=False)
class ImageJob:
    """One residual image: along which direction, at which size."""

    direction: Array
    height: int
    width: int


def image_jobs(plan: TexturePlan, closed: bool) -> tuple[Array, list[ImageJob]]:
    """Return the spiral's alphas (n,) and one job per direction, sized by the repaired scale factors (eq. 6)."""
    alphas = spiral.table(plan.k, closed)
    directions = spiral.directions(alphas, plan.k, spiral.LIMIT if closed else np.pi / 2)
    jobs = []
    for direction in directions:
        rx, ry = spiral.scale_factors(direction)
        width = max(1, round(plan.rectangle.width * plan.residual_scale * rx))
        height = max(1, round(plan.rectangle.height * plan.residual_scale * ry))
        jobs.append(ImageJob(direction, height, width))
    return alphas, jobs


def sample_image(
    plan: TexturePlan, job: ImageJob, caster: MeshCaster, photos: PhotoSet, diffuse: DiffuseSource
) -> tuple[Array, Array]:
    """Colour seen along one direction and diffuse colour of the same points, (H * W, 3) float32 linear, NaN = none."""
    frame = plan.rectangle.edges
    basis = np.stack([frame.a / np.linalg.norm(frame.a), frame.b / np.linalg.norm(frame.b), -frame.f])
    toward = job.direction @ basis
    u, v = np.meshgrid((np.arange(job.width) + 0.5) / job.width, (np.arange(job.height) + 0.5) / job.height)
    origins = frame.origin + u.reshape(-1, 1) * frame.a + v.reshape(-1, 1) * frame.b
    hits = caster.cast(origins, np.broadcast_to(-toward, origins.shape))
    seen = np.full((len(origins), 3), np.nan, np.float32)
    base = np.full((len(origins), 3), np.nan, np.float32)
    hit = np.flatnonzero((hits.face >= 0) & ((hits.normal @ toward) > 0))
    if len(hit):
        points = origins[hit] - hits.t[hit, None].astype(np.float64) * toward
        normals = caster.smooth_normals(hits.face[hit], hits.uv[hit])
        seen[hit], _ = photos.blend(points, normals, np.broadcast_to(toward, points.shape))
        base[hit] = diffuse.at(points, normals)
    return seen, base


def build_residuals(
    plan: TexturePlan, caster: MeshCaster, photos: PhotoSet, diffuse: DiffuseSource, config: ResidualsConfig
) -> tuple[SpiralResiduals, dict[str, Any]]:
    """Sample all directions of one texture and code the differences.

    Returns
    -------
    residuals : SpiralResiduals
    figures : dict
        Directions, texels, valid share, clamped share, zero offset.
    """
    alphas, jobs = image_jobs(plan, config.closed)
    pool = current_executor()
    pending = [pool.submit(sample_image, plan, job, caster, photos, diffuse) for job in jobs]
    found = [work.result() for work in track(pending, f"residuals {plan.rectangle.name}")]
    seen, base = (np.concatenate(part) for part in zip(*found, strict=True))
    valid = np.isfinite(seen).all(axis=1) & np.isfinite(base).all(axis=1)
    texels, zero, clamped = encode(seen, base, valid, config)
    sizes = np.array([(job.height, job.width) for job in jobs], np.int32)
    starts = np.concatenate([[0], np.cumsum(sizes.astype(np.int64).prod(axis=1))])
    directions = np.stack([job.direction for job in jobs])
    residuals = SpiralResiduals(
        plan.rectangle.edges, plan.k, alphas, directions, sizes, starts, texels, valid, zero, config.closed
    )
    figures = {
        "name": plan.rectangle.name,
        "directions": len(jobs),
        "texels": len(valid),
        "valid_share": float(valid.mean()),
        "clamped_texels": int(clamped),
        "clamped_share": float(clamped / max(valid.sum(), 1)),
        "zero": zero,
        "encoding": config.encoding,
    }
    return residuals, figures


def encode(seen: Array, base: Array, valid: Array, config: ResidualsConfig) -> tuple[Array, int, int]:
    """Code differences (T, 3); return texels, zero offset and how many valid texels were clamped."""
    if config.encoding == "half":
        texels = np.where(valid[:, None], seen - base, 0.0).astype(np.float16).astype(np.float32)
        return texels, 0, 0
    difference = np.zeros(seen.shape, np.float32)
    difference[valid] = np.round(255.0 * (srgb_encode(seen[valid]) - srgb_encode(base[valid])))
    zero = choose_zero(difference[valid]) if config.zero == "auto" else config.zero
    shifted = difference + zero
    clamped = ((shifted < 0) | (shifted > 255)).any(axis=1)
    return np.clip(shifted, 0, 255).astype(np.uint8), zero, int(clamped.sum())


def choose_zero(difference: Array) -> int:
    """Zero offset that clamps fewest values of whole-number differences (V, 3); 32 where nothing clamps."""
    if difference.size == 0:
        return 32
    counts = np.bincount(np.clip(difference, -255, 255).astype(np.int64).ravel() + 255, minlength=511)
    inside = [counts[255 - zero : 511 - zero].sum() for zero in range(256)]
    best = max(inside)
    return 32 if inside[32] == best else int(np.argmax(inside))


def run(inputs: Inputs, config: ResidualsConfig) -> Outputs:
    """Sample residuals for every texture that the plan wants them for.

    Raises
    ------
    CaptureError, FormatError
        The views, the mesh, the plan or the layers cannot be read.
    """
    plans = read_plan(inputs.plan)
    wanted = [i for i, plan in enumerate(plans) if plan.residuals]
    figures, files = [], []
    if wanted:
        caster = MeshCaster(read_mesh(inputs.mesh))
        photos = load_photos(read_views(inputs.views).train, caster)
        diffuse = _diffuse_source(plans, inputs.layers)
    for which in wanted:
        residuals, figure = build_residuals(plans[which], caster, photos, diffuse, config)
        folder = inputs.out / f"texture_{which:02d}"
        folder.mkdir(parents=True, exist_ok=True)
        path = write_residuals(residuals, folder, config.quality)
        figures.append({**figure, "texture": which, "bytes": path.stat().st_size})
        files.append(path)
    summary = inputs.out / "residuals.json"
    summary.write_text(json.dumps({"textures": figures}, indent=1), encoding="utf-8")
    return Outputs(summary, tuple(files))


def _diffuse_source(plans: Sequence[TexturePlan], folder: Path) -> DiffuseSource:
    layers = [read_layers(folder / f"texture_{i:02d}" / "layers.exr") for i in range(len(plans))]
    return DiffuseSource([plan.rectangle for plan in plans], layers)


STAGE = Stage(
    name="residuals",
    summary="Sample view-dependent residuals along the spiral directions of every texture that needs them.",
    inputs=Inputs,
    config=ResidualsConfig,
    run=run,
    needs=("ingest", "plan", "layers"),
    example="ibrpipe residuals --views out/ingest/views.json --mesh out/ingest/mesh.ply --plan out/plan/plan.json "
    "--layers out/layers --out out",
)
