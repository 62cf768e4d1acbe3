"""Code the asset of a run in many ways; measure bytes, error on held-out photos, decoding and drawing."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter

import numpy as np

from ibrpipe.bench.rate_error.results import RateCurve, RateErrorModel, RatePoint
from ibrpipe.capture.photo_set import load_photos
from ibrpipe.embree import MeshCaster
from ibrpipe.engine.artifacts import earlier, paths_below, products
from ibrpipe.engine.machine import describe_machine
from ibrpipe.errors import MissingFileError
from ibrpipe.evaluation.baselines import render_ulr
from ibrpipe.evaluation.held_out import held_out_views, load_truth
from ibrpipe.evaluation.image_scores import score_frame
from ibrpipe.evaluation.metrics import Scores, mean_scores
from ibrpipe.evaluation.photo_fit import PhotoFit
from ibrpipe.evaluation.sizes import bytes_of
from ibrpipe.evaluation.timing import timed_size
from ibrpipe.io.assets import AssetIndex, read_asset, read_index
from ibrpipe.io.layer_pictures import Coding
from ibrpipe.io.layer_pictures.avif import QUICK
from ibrpipe.io.manifest import files_below
from ibrpipe.io.recoding import finish, recode
from ibrpipe.io.surfaces.meshes import read_mesh
from ibrpipe.io.views import View, read_views
from ibrpipe.modelling.compression.coarser import write_coarser
from ibrpipe.modelling.compression.parts import Parts, Source, curves_of
from ibrpipe.modelling.compression.steps import CodingStep
from ibrpipe.modelling.compression.tradeoff import choices, step_of_choice
from ibrpipe.progress import track
from ibrpipe.renderers.api import prepare, render
from ibrpipe.stages.registry import load_stage, load_stages
from ibrpipe.types import Asset, Camera, Frame, Texture
from ibrpipe.types.layers import pitch_of

WIDTH = 640
_FRAMES, _READS = 5, 3
#: training photos by which parts are weighed, codings on the way from fine to coarse, texels that are joined further on
_FITTED, _POINTS, _JOINED = 6, 9, (2, 4, 8)
#: depth levels and words of gong-yang
_LEVELS, _WORDS = 256, 256
#: quality of colours whose chroma is halved: what halving alone loses is seen
_HALVED = 96

Draw = Callable[[Camera], Frame]


def run_rate_error(runs: Sequence[Path], most_views: int) -> RateErrorModel:
    """Measure the assets of several run folders.

    Raises
    ------
    MissingFileError
        A folder is no run folder with asset, views and mesh.
    CaptureError
        No view is held out.
    """
    began = perf_counter()
    curves = [_curve(run, most_views) for run in runs]
    return RateErrorModel(machine=describe_machine(), curves=curves, seconds=perf_counter() - began)


def _curve(run: Path, most_views: int) -> RateCurve:
    made = paths_below(run, products(earlier(load_stage("compress"), load_stages())))
    for part in (made["index"], made["views"], made["mesh"]):
        if not part.is_file():
            raise MissingFileError(f"{part}: no such file; give the folder of a run that has got as far as asset")
    views, mesh = read_views(made["views"]), read_mesh(made["mesh"])
    tested = _spread(held_out_views(views), most_views)
    photos = bytes_of(made["asset"], views.train, made["mesh"])["photos"]
    points = []
    with TemporaryDirectory(prefix="ibrpipe-") as scratch:
        for series, label, folder in track(
            list(_codings(made["asset"], Path(scratch), views.train)), f"rate-error {run.name}"
        ):
            points.append(_measured(series, label, folder, tested, photos))
    caster = MeshCaster(mesh)
    shown = load_photos(views.train, caster)
    scores = _scores(tested, lambda camera: render_ulr(camera, caster, shown))
    points.append(_point("lumigraph", "photos, blended", photos, photos, scores))
    return RateCurve(
        run=run.resolve().name, photo_bytes=photos, views=[view.name for view in tested], width=WIDTH, points=points
    )


def _codings(source: Path, scratch: Path, train: Sequence[View]) -> Iterator[tuple[str, str, Path]]:
    """Write the asset in every coding; yield series, label and folder."""
    whole = Source(source, _untold(read_index(source)), read_asset(source))
    yield "raw", "deep OpenEXR", _written(whole, scratch / "raw", CodingStep(Coding()), raw=True)
    name = "whole" if whole.asset.kinds else "diffuse"
    steps = _steps(whole, train, _POINTS)
    for n, step in enumerate([CodingStep(), *steps]):
        yield name, _words(step), _written(whole, scratch / f"whole_{n}", step)
    for factor in _JOINED:
        joined = write_coarser(whole, factor, scratch / f"joined_{factor}")
        joined = replace(joined, index=_untold(joined.index))
        for n, step in enumerate(_steps(joined, train, 3)[1:]):
            words = f"{factor} x {factor} texels joined, {_words(step)}"
            yield name, words, _written(joined, scratch / f"joined_{factor}_{n}", step)
    if whole.asset.kinds:
        bare = _bare(whole)
        for n, layers in enumerate(dict.fromkeys(step.layers for step in steps[::3])):
            step = CodingStep(layers)
            yield "diffuse", _words(step), _written(bare, scratch / f"diffuse_{n}", step)
    for n, (label, layers) in enumerate(paper_codings(whole.asset).items()):
        yield "paper", label, _written(whole, scratch / f"paper_{n}", CodingStep(layers))


def _untold(index: AssetIndex) -> AssetIndex:
    """Return the index without what only tells how the asset was made: at few bytes that would be most of them."""
    textures = [entry.model_copy(update={"measured": {}}) for entry in index.textures]
    return index.model_copy(update={"textures": textures, "provenance": {}})


def _steps(source: Source, train: Sequence[View], count: int) -> list[CodingStep]:
    """Return about so many codings as `ibrpipe compress` chooses from, evenly spread over bytes, large ones first."""
    fit = PhotoFit(_spread(train, _FITTED), source.asset)
    ladder = choices(curves_of(Parts(source, fit.psnr, fit.psnr(source.asset) or 0.0), {}))
    sizes = np.log([choice.size for choice in ladder])
    wanted = np.linspace(sizes.max(), sizes.min(), count)
    places = dict.fromkeys(int(np.abs(sizes - size).argmin()) for size in wanted)
    return list(dict.fromkeys(step_of_choice(ladder[place], {}) for place in places))


def paper_codings(asset: Asset) -> dict[str, Coding]:
    """Return the codings of gong-yang: depths in 8 bits over the deepest texture's range, and vector quantisation."""
    shares = [
        float(np.ptp(texture.layers.depth)) / (_LEVELS - 1) / pitch_of(texture.layers)
        for texture in asset.textures
        if len(texture.layers.depth)
    ]
    share = min(max([*shares, 1e-6]), 16.0)
    return {
        "8-bit depth": Coding(depth_step=share, normal_bits=8),
        "8-bit depth, half chroma": Coding(color_quality=_HALVED, half_chroma=True, depth_step=share, normal_bits=8),
        "vector quantisation": Coding(depth_step=share, normal_bits=8, codewords=_WORDS),
    }


def _bare(source: Source) -> Source:
    """Return the same without view dependence."""
    entries = [entry.model_copy(update={"components": []}) for entry in source.index.textures]
    textures = tuple(Texture(texture.layers) for texture in source.asset.textures)
    index = source.index.model_copy(update={"textures": entries, "shared": []})
    return Source(source.folder, index, Asset(textures, source.asset.info))


def _written(source: Source, out: Path, step: CodingStep, raw: bool = False) -> Path:
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir(parents=True)
    layers = None if raw else step.layers
    fresh = recode(source.folder, source.index, source.asset, out, layers, step.quality_of, QUICK)
    finish(fresh, out, [None] * len(fresh.textures))
    return out


def _words(step: CodingStep) -> str:
    said = [f"{name.replace('_', ' ')} {value:g}" for name, value in step.layers.model_dump().items()]
    said += [] if step.weights is None else [f"weights {step.weights}"]
    said += [] if step.components is None else [f"components {step.components}"]
    return ", ".join(said) or "lossless"


def _measured(series: str, label: str, folder: Path, views: Sequence[View], photos: int) -> RatePoint:
    seconds = []
    for _ in range(_READS):
        began = perf_counter()
        asset = read_asset(folder)
        seconds.append(perf_counter() - began)
    prepared = prepare(asset, "ldi")
    scores = _scores(views, lambda camera: render(prepared, camera))
    camera, times = timed_size(views[0].camera, WIDTH), []
    for _ in range(_FRAMES):
        began = perf_counter()
        render(prepared, camera)
        times.append(1e3 * (perf_counter() - began))
    size = sum(path.stat().st_size for path in files_below(folder))
    found = _point(series, label, size, photos, scores)
    return found.model_copy(update={"decode_seconds": min(seconds), "ms_per_frame": min(times)})


def _point(series: str, label: str, size: int, photos: int, scores: Scores) -> RatePoint:
    return RatePoint(
        series=series, label=label, bytes=size, share=size / max(photos, 1), psnr=scores.psnr, ssim=scores.ssim,
        flip=scores.flip,
    )  # fmt: skip


def _scores(views: Sequence[View], draw: Draw) -> Scores:
    return mean_scores([score_frame(load_truth(view), draw(view.camera)) for view in views])


def _spread(views: Sequence[View], count: int) -> list[View]:
    places = np.unique(np.linspace(0, len(views) - 1, min(count, len(views))).round().astype(int))
    return [views[place] for place in places]
