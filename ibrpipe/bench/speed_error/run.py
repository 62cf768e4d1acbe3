"""Speed against error of all renderers and peers, in one interleaved run."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from statistics import median
from time import perf_counter
from typing import Literal

import numpy as np

from ibrpipe.bench.oracles import fields as oracle
from ibrpipe.bench.settings import Setting
from ibrpipe.bench.sizes import growth
from ibrpipe.bench.speed_error.advice import choose_winners
from ibrpipe.bench.speed_error.contenders import Contender, Ready, all_contenders
from ibrpipe.bench.speed_error.measure import ErrorMaps, Errors, measure, ray_lengths
from ibrpipe.bench.speed_error.results import (
    ContenderFacts,
    Growth,
    Preparation,
    Score,
    SpeedErrorModel,
    Timing,
    WorkFacts,
)
from ibrpipe.bench.speed_error.workloads import FIRST, Workload, bumpy_torus, height_field, object_of, strided
from ibrpipe.core.color import srgb_encode
from ibrpipe.engine.machine import describe_machine
from ibrpipe.evaluation.timing import Times, interleave
from ibrpipe.progress import track
from ibrpipe.types import Array, Camera, Frame, Mesh

#: views whose errors are shown as pictures
SHOWN = ("oblique 60", "grazing 85", "corner")


@dataclass(frozen=True)
class Preset:
    """Sizes and repeats of a run.

    Attributes
    ----------
    name : str
    width : int
        Of the pictures in pixels; their height is three quarters of it.
    fields, objects : tuple of int
        Texels along a side.
    growing : tuple of int
        Texels and pixels along a side where both grow.
    repeats : int
        Timed frames of each contender in each view.
    seconds, growth_seconds : float
        Of timing for each view; for each size and region of the curves of growth.
    """

    name: Literal["quick", "full"]
    width: int
    fields: tuple[int, ...]
    objects: tuple[int, ...]
    growing: tuple[int, ...]
    repeats: int
    seconds: float
    growth_seconds: float


QUICK = Preset("quick", 160, (64, 128), (48,), (64, 128), 3, 1.0, 0.1)
FULL = Preset("full", 640, (128, 256, 512, 1024, 2048), (64, 128, 256), (128, 256, 512, 1024, 2048), 9, 8.0, 2.5)


@dataclass(frozen=True, eq=False)
class Shown:
    """Where errors sit in one frame: texels along the ray (H, W), NaN where nothing is, and wrong pixels (H, W)."""

    work: str
    view: str
    contender: str
    texels: Array
    wrong: Array


@dataclass
class SpeedRun:
    """What a run found, and pictures of where errors sit."""

    model: SpeedErrorModel
    shown: list[Shown] = field(default_factory=list)


def run_speed_error(
    settings: Sequence[Setting],
    preset: Preset,
    mesh: tuple[str, Mesh] | None = None,
    keep: Callable[[SpeedErrorModel], None] | None = None,
) -> SpeedRun:
    """Time all contenders on all things and measure their errors.

    Parameters
    ----------
    settings : sequence of Setting
    preset : Preset
    mesh : (str, Mesh), optional
        Name and triangles of a further object.
    keep : callable, optional
        Is given what there is so far after each thing, so that an interrupted run leaves it.
    """
    began, contenders = perf_counter(), all_contenders(settings, preset.name == "quick")
    run = _Gathered()
    objects = [("torus", bumpy_torus(120 if preset.name == "quick" else 400)), *([mesh] if mesh else [])]
    jobs = [partial(height_field, n, preset.width) for n in preset.fields]
    for name, each in objects:
        jobs += [partial(object_of, each, name, n, preset.width) for n in preset.objects]
        jobs.append(partial(object_of, each, name, preset.objects[-1], preset.width, first=True))
    for make in track(jobs, "speed and error"):
        work = make()
        _render_all(work, contenders, preset, run)
        if keep is not None:
            keep(_model(run, contenders, preset, [], began))
    curves = growth.grow_texels(run.scores, run.works)
    curves += growth.grow_both(contenders, preset.growing, 2.0 * preset.growth_seconds)
    curves += growth.grow_regions(contenders, preset.growing, preset.growth_seconds)
    return SpeedRun(_model(run, contenders, preset, curves, began), run.shown)


def _model(
    run: _Gathered, contenders: Sequence[Contender], preset: Preset, curves: list[Growth], began: float
) -> SpeedErrorModel:
    spreads = [(t.high - t.low) / t.milliseconds for s in run.scores for t in (s.depth, s.both) if t and t.frames > 2]
    return SpeedErrorModel(
        machine=describe_machine(),
        preset=preset.name,
        width=preset.width,
        height=preset.width * 3 // 4,
        contenders=[
            ContenderFacts(label=c.label, renderer=c.renderer, what=c.what, options=dict(c.options), main=c.main)
            for c in contenders
        ],
        works=run.works,
        preparations=run.preparations,
        scores=run.scores,
        growth=curves,
        choices=choose_winners(run.scores, run.works),
        spread=median(spreads) if spreads else None,
        seconds=perf_counter() - began,
    )


@dataclass
class _Gathered:
    works: list[WorkFacts] = field(default_factory=list)
    preparations: list[Preparation] = field(default_factory=list)
    scores: list[Score] = field(default_factory=list)
    shown: list[Shown] = field(default_factory=list)


def _render_all(work: Workload, contenders: Sequence[Contender], preset: Preset, run: _Gathered) -> None:
    facts = WorkFacts(name=work.name, kind=work.kind, n=work.n, texels=work.texels, views=list(work.views))
    run.works.append(facts)
    made = {contender.label: contender.make(work) for contender in contenders}
    ready = {name: each for name, each in made.items() if each is not None}
    for name, each in ready.items():
        prepared = Preparation(work=work.name, contender=name, milliseconds=each.milliseconds, bytes=each.bytes)
        run.preparations.append(prepared)
    for view, camera in work.views.items():
        depth, both = _timed(ready, camera, preset)
        truths = _Truths(work, camera)
        for contender in contenders:
            if contender.label not in ready:
                continue
            score, maps = _scored(work, view, contender, ready[contender.label].frame(camera), truths)
            name = contender.label
            run.scores.append(score.model_copy(update={"depth": depth.get(name), "both": both.get(name)}))
            if (
                view in SHOWN
                and not work.name.endswith(FIRST)
                and work.n == _middle(preset.fields if work.kind == "height field" else preset.objects)
            ):
                run.shown.append(Shown(work.name, view, name, maps.texels.astype(np.float32), maps.wrong))


def _middle(sizes: Sequence[int]) -> int:
    return sizes[len(sizes) // 2]


def _timed(ready: dict[str, Ready], camera: Camera, preset: Preset) -> tuple[dict[str, Timing], dict[str, Timing]]:
    """Return the times of depth alone, and of colour and depth, of everyone in turns."""
    draws = {(name, "depth"): each.depth(camera) for name, each in ready.items() if each.depth}
    draws |= {(name, "both"): each.both(camera) for name, each in ready.items() if each.both}
    times = interleave(
        {f"{name}\n{what}": draw for (name, what), draw in draws.items()}, preset.repeats, preset.seconds
    )
    found: dict[str, dict[str, Timing]] = {"depth": {}, "both": {}}
    for key, value in times.items():
        name, what = key.split("\n")
        found[what][name] = _timing(value)
    return found["depth"], found["both"]


def _timing(times: Times) -> Timing:
    return Timing(milliseconds=times.median, low=times.low, high=times.high, fastest=times.fastest, frames=times.count)


class _Truths:
    """Exact answers of one view: of the patches, of the triangles, of what was sampled, and the true colours."""

    def __init__(self, work: Workload, camera: Camera) -> None:
        self.patches = oracle.cast_truth(work.surfaces, camera)
        self.triangles = self._split(work, camera) if work.kind == "height field" else self._mesh(work, camera)
        self.colors = srgb_encode(work.true_colors(camera).clip(0, 1))

    def _split(self, work: Workload, camera: Camera) -> oracle.Truth:
        found = oracle.cast(work.surfaces, camera, oracle.pixel_centers(camera), split=True, brute=False)
        depth, patch, owner = (part.reshape(camera.height, camera.width) for part in found)
        return oracle.Truth(depth, patch, owner, depth, depth)

    def _mesh(self, work: Workload, camera: Camera) -> oracle.Truth:
        depth = work.caster.cast_camera(camera).t.astype(np.float64)
        none = np.full(depth.shape, -1)
        return oracle.Truth(depth, none, np.where(np.isfinite(depth), 0, -1), depth, depth)


def _scored(work: Workload, view: str, contender: Contender, frame: Frame, truths: _Truths) -> tuple[Score, ErrorMaps]:
    camera = work.views[view]
    own = truths.triangles if contender.triangles else truths.patches
    meant = truths.patches if work.kind == "height field" else truths.triangles
    errors, maps = measure(work.surfaces, own, None, camera, frame)
    against = _plain_errors(work, meant, camera, frame)
    clipped = np.where(maps.wrong, 1.0, np.nan_to_num(np.minimum(maps.texels, 1.0)))
    score = Score(
        work=work.name,
        view=view,
        contender=contender.label,
        depth=None,
        both=None,
        wrong=_wrong_share(errors),
        rmse=errors.rmse,
        p99=errors.texels_p99,
        worst=errors.texels,
        clipped=float(clipped.mean()),
        codes=_color_error(frame, truths.colors, camera),
        meant_wrong=against[0],
        meant_rmse=against[1],
    )
    return score, maps


def _wrong_share(errors: Errors) -> float:
    return min(1.0, (errors.wrong + errors.nan) / errors.pixels)


def _plain_errors(work: Workload, truth: oracle.Truth, camera: Camera, frame: Frame) -> tuple[float, float]:
    """Share of wrong pixels, and rmse of the others in texels, against depths without doubt."""
    assert frame.depth is not None
    got, texel = frame.depth.astype(np.float64), max(surface.texel for surface in work.surfaces)
    both = np.isfinite(got) & np.isfinite(truth.depth)
    away = np.abs(got[both] - truth.depth[both]) * ray_lengths(camera)[both] / texel
    wrong = int((np.isfinite(got) != np.isfinite(truth.depth)).sum()) + int((away > 1.0).sum())
    right = away[away <= 1.0]
    return wrong / got.size, float(np.sqrt(np.mean(right**2))) if len(right) else 0.0


def _color_error(frame: Frame, wanted: Array, camera: Camera) -> float | None:
    if frame.color is None:
        return None
    x, y = np.moveaxis(strided(camera).astype(np.int64), -1, 0)
    got = srgb_encode(np.nan_to_num(frame.color[y, x]).astype(np.float64).clip(0, 1))
    return float(255.0 * np.sqrt(np.mean((got - wanted) ** 2)))
