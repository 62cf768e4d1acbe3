"""What stands between a spiral-texture asset and the photos: every loss of a finished run measured on its own.

    python -m ibrpipe.bench.ablation OUT

reads the run folder OUT of ``ibrpipe run`` and writes ``OUT/ablation.json`` and ``OUT/ablation.md``. Figures are PSNR
in the mask, 8-bit sRGB, mean over the held-out views.
"""

from __future__ import annotations

import dataclasses
import json
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from ibrpipe.core.color import srgb_decode
from ibrpipe.core.psnr import psnr
from ibrpipe.core.spiral import directions
from ibrpipe.core.spiral.lookup import neighbours
from ibrpipe.engine.artifacts import paths_below
from ibrpipe.engine.artifacts import sources as stage_inputs
from ibrpipe.engine.executor import executor
from ibrpipe.errors import CaptureError, ConfigError, IbrError
from ibrpipe.evaluation.baselines import render_ulr
from ibrpipe.evaluation.image_scores import to_srgb8
from ibrpipe.io.manifest import read_manifest
from ibrpipe.io.residuals import read_residuals, write_residuals
from ibrpipe.io.views import View, load_view, read_views
from ibrpipe.modelling.diffuse import diffuse_frame
from ibrpipe.modelling.plan_file import TexturePlan
from ibrpipe.modelling.rectangles import passed
from ibrpipe.modelling.view_dependence.coding import code
from ibrpipe.modelling.view_dependence.sample_sets import Samples, assemble, uncoded
from ibrpipe.modelling.view_dependence.spiral import ResidualsConfig, refine, sample
from ibrpipe.modelling.view_dependence.spiral_plan import SPIRAL, spiral_of
from ibrpipe.modelling.view_dependence.work_units import Context, Sources, context_of, forget
from ibrpipe.renderers.api import prepare, render
from ibrpipe.renderers.view_dependence import spiral as residual_pass
from ibrpipe.stages.registry import load_stage, load_stages
from ibrpipe.types import Array, Asset, Camera, SpiralResiduals, SpiralTexture

#: linear picture (H, W, 3) of a camera
Shot = Callable[[Camera], Array]
Row = tuple[str, str, float]


def measure(run: Path, config: ResidualsConfig) -> list[Row]:
    """Measure all variants; returns (group, what, PSNR in dB).

    Raises
    ------
    CaptureError
        The run has no held-out views, or its plan wants no residuals.
    """
    stage = load_stage("residuals")
    paths = paths_below(run, stage_inputs(stage, load_stages()))
    sources = Sources(**{name: path for name, path in paths.items() if name != "sides" or path.exists()})
    context, views = context_of(sources), read_views(sources.views).test
    wanted = [i for i, plan in enumerate(context.plans) if plan.component(SPIRAL)]
    if not views or not wanted:
        raise CaptureError(f"{run}: needs held-out views and a plan with residuals; set plan.residuals=always")
    with tempfile.TemporaryDirectory() as folder:
        rows = _variants(context, sources, wanted, config, Path(folder))
        return [(group, what, score(views, shot)) for group, what, shot in rows]


def _variants(
    context: Context, sources: Sources, wanted: Sequence[int], config: ResidualsConfig, scratch: Path
) -> list[tuple[str, str, Shot]]:
    def build(**changes: object) -> list[Samples]:
        changed = config.model_copy(update=changes)
        found = [sample(sources, which, changed) for which in wanted]
        refine(sources, found, scratch / "errors.npy", changed)
        return found

    k = spiral_of(context.plans[wanted[0]]).k
    refined, published = build(), build(closed=False)
    raw = build(refine=0)
    files = {q: coded(context, refined, config, q, scratch) for q in (config.quality, 100)}
    full = files[config.quality]
    exact = _on_mesh(context, _floats(context, refined, config.closed))
    return [
        ("added one by one", "lumigraph: four photos at every pixel, on the mesh", _lumigraph(context)),
        (
            "added one by one",
            "four spiral directions instead of the exact one",
            _directions(context, k, config.closed),
        ),
        (
            "added one by one",
            "residual and diffuse texels (double interpolation)",
            _on_mesh(context, _floats(context, raw, config.closed)),
        ),
        ("added one by one", "refinement", exact),
        ("added one by one", "8 bits", _on_mesh(context, files[100])),
        ("added one by one", f"WebP quality {config.quality}", _on_mesh(context, full)),
        ("added one by one", "layers instead of the mesh: the asset", _layers(context, full)),
        ("switched off in turn", "nothing: the asset", _layers(context, full)),
        ("switched off in turn", "geometry sampling: the mesh instead of layers", _on_mesh(context, full)),
        ("switched off in turn", "WebP: lossless", _layers(context, files[100])),
        (
            "switched off in turn",
            "8 bits and WebP: float residuals",
            _layers(context, _floats(context, refined, config.closed)),
        ),
        ("switched off in turn", "refinement", _layers(context, coded(context, raw, config, config.quality, scratch))),
        (
            "switched off in turn",
            "closing turn: the published spiral",
            _layers(
                context, coded(context, published, config.model_copy(update={"closed": False}), config.quality, scratch)
            ),
        ),
        ("switched off in turn", "residuals: diffuse colour only", _layers(context, {})),
    ]


def score(views: Sequence[View], shot: Shot) -> float:
    """Mean PSNR of a method, dB, in the masks of the views."""
    found = []
    for view in views:
        color, mask = load_view(view)
        value = psnr(to_srgb8(color), to_srgb8(shot(view.camera)), mask >= 0.5)
        found += [] if value is None else [value]
    return float(np.mean(found))


Residuals = dict[int, SpiralResiduals]


def coded(
    context: Context, samples: Sequence[Samples], config: ResidualsConfig, quality: int, scratch: Path
) -> Residuals:
    """Write residuals with 8 bits and read them back."""
    found = {}
    for s in samples:
        texels, valid, zero, _ = code(s, config)
        residuals = assemble(context.plans[s.which], config.closed, texels, valid, zero)
        found[s.which] = read_residuals(write_residuals(residuals, scratch, quality))
    return found


def _floats(context: Context, samples: Sequence[Samples], closed: bool) -> Residuals:
    return {s.which: uncoded(context, s, closed) for s in samples}


def _textures(context: Context, residuals: Residuals) -> tuple[SpiralTexture, ...]:
    return tuple(SpiralTexture(layers, residuals.get(i)) for i, layers in enumerate(context.layers))


def _layers(context: Context, residuals: Residuals) -> Shot:
    """The renderer `ldi` of the asset."""
    plain = prepare(Asset(tuple(SpiralTexture(layers) for layers in context.layers)), "ldi")
    tables = _tables(context, residuals) if residuals else None

    def shot(camera: Camera) -> Array:
        frame = render(plain, camera)
        color, depth = np.array(frame.color), np.asarray(frame.depth)
        if tables is not None:
            residual_pass.add(tables, color, depth, camera)
        return color

    return shot


def _tables(context: Context, residuals: Residuals) -> residual_pass.Tables:
    """Tables for 8-bit residuals and for uncoded ones, which are in display code too."""
    return dataclasses.replace(residual_pass.prepare(_textures(context, residuals)), coded=True)


def _on_mesh(context: Context, residuals: Residuals) -> Shot:
    """Diffuse texels and residuals looked up at the mesh's own surface points."""
    tables = _tables(context, residuals)

    def shot(camera: Camera) -> Array:
        color, depth, _ = diffuse_frame(context.caster, context.diffuse, camera)
        residual_pass.add(tables, color, depth, camera)
        return color

    return shot


def _lumigraph(context: Context) -> Shot:
    return lambda camera: np.asarray(render_ulr(camera, context.caster, context.photos).color)


def _directions(context: Context, k: float, closed: bool) -> Shot:
    """Photos blended at the surface point for the four spiral directions around the view, without any texels.

    Of all planned textures the one whose rectangle the view ray passes most steeply is asked; `k`: spiral density.
    """
    alphas = directions.table(k, closed)

    def shot(camera: Camera) -> Array:
        hits = context.caster.cast_camera(camera)
        hit = np.isfinite(hits.t)
        rays = camera.pixel_rays()[hit]
        points = camera.center + rays * hits.t[hit][:, None].astype(np.float64)
        toward = -rays / np.linalg.norm(rays, axis=1, keepdims=True)
        normals = context.caster.smooth_normals(hits.face[hit], hits.uv[hit])
        owner = passed([plan.rectangle for plan in context.plans], points, toward)
        found = np.zeros((len(points), 3), np.float32)
        for which, plan in enumerate(context.plans):
            own = np.flatnonzero(owner == which)
            if len(own):
                towards, weights = around(plan, k, alphas, closed, toward[own])
                found[own] = _mixed(context, points[own], normals[own], towards, weights)
        color = np.zeros((*hit.shape, 3), np.float32)
        color[hit] = srgb_decode(found)
        return color

    return shot


def around(plan: TexturePlan, k: float, alphas: Array, closed: bool, toward: Array) -> tuple[Array, Array]:
    """World directions (N, 4, 3) and weights (N, 4) of the spiral samples around unit directions (N, 3)."""
    frame = plan.rectangle.edges
    basis = np.stack([frame.a / np.linalg.norm(frame.a), frame.b / np.linalg.norm(frame.b), -frame.f])
    limit, closing = (directions.LIMIT, directions.closing_count(k)) if closed else (np.pi / 2, 0)
    indices, weights = np.zeros((len(toward), 4), np.int64), np.zeros((len(toward), 4))
    for i, (x, y, z) in enumerate(toward @ basis.T):
        neighbours(x, y, z, alphas, 0, len(alphas), k, limit, closing, indices[i], weights[i])
    return (directions.directions(alphas, k, limit) @ basis)[indices], weights


def _mixed(context: Context, points: Array, normals: Array, towards: Array, weights: Array) -> Array:
    """Display codes (N, 3) of the four directions, weighted; 0 where no photo sees the point."""
    total = np.zeros((len(points), 3), np.float32)
    for n in range(4):
        codes, _ = context.photos.blend_codes(points, normals, towards[:, n])
        total += weights[:, n, None].astype(np.float32) * np.nan_to_num(codes)
    return total


def as_table(rows: Sequence[Row]) -> str:
    """Markdown: every figure, and how it differs from the one before (added) or from the asset (switched off)."""
    lines, groups = [], dict.fromkeys(group for group, _, _ in rows)
    for group in groups:
        own = [(what, value) for name, what, value in rows if name == group]
        lines += [f"| {group} | PSNR (dB) | difference |", "|---|---:|---:|"]
        for i, (what, value) in enumerate(own):
            base = own[max(i - 1, 0)][1] if group == "added one by one" else own[0][1]
            lines.append(f"| {what} | {value:.2f} | {f'{value - base:+.2f}' if i else ''} |")
        lines.append("")
    return "\n".join(lines)


def main(arguments: Sequence[str]) -> int:
    """Measure the run folder that is given; return the exit code."""
    try:
        if len(arguments) != 1:
            raise ConfigError("give one run folder: python -m ibrpipe.bench.ablation OUT")
        run = Path(arguments[0])
        with executor():
            rows = measure(run, _config_of(run))
    except IbrError as error:
        sys.stderr.write(f"{error}\n")
        return 1
    finally:
        forget()
    (run / "ablation.json").write_text(json.dumps([list(row) for row in rows], indent=1), encoding="utf-8")
    (run / "ablation.md").write_text(as_table(rows), encoding="utf-8")
    sys.stdout.write(as_table(rows))
    return 0


def _config_of(run: Path) -> ResidualsConfig:
    """Return the settings that the run's residuals were made with; the defaults if no manifest tells."""
    manifest = read_manifest(run / load_stage("residuals").folder)
    return ResidualsConfig() if manifest is None else ResidualsConfig.model_validate(manifest.config)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
