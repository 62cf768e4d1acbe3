"""Residuals: work units that are the same anywhere, refinement on the training photos, coding."""

from __future__ import annotations

import json
import pickle
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import pytest

from ibrpipe.core.color import srgb_decode, srgb_encode
from ibrpipe.engine.executor import executor
from ibrpipe.io.residuals import read_residuals
from ibrpipe.modelling.plan_file import read_plan
from ibrpipe.modelling.view_dependence import coding, sample_sets, spiral
from ibrpipe.modelling.view_dependence import spiral_images as spiral_images_module
from ibrpipe.modelling.view_dependence.back_projection import errors_in_batches, photo_errors
from ibrpipe.modelling.view_dependence.coding import code
from ibrpipe.modelling.view_dependence.sample_sets import Samples, in_batches, uncoded
from ibrpipe.modelling.view_dependence.spiral import ResidualsConfig, sample
from ibrpipe.modelling.view_dependence.spiral_images import SpiralImage, chunks, spiral_images
from ibrpipe.modelling.view_dependence.spiral_plan import spiral_of
from ibrpipe.modelling.view_dependence.work_units import Sources, context_of, forget, sample_images
from ibrpipe.stages import ingest, layers, plan, residuals
from ibrpipe.types import SpiralTexture


@pytest.fixture(scope="module")
def sources(tiny_ball: Path, tmp_path_factory: pytest.TempPathFactory) -> Sources:
    """Plan and layers of the glossy ball, coarse, residuals everywhere."""
    root = tmp_path_factory.mktemp("ball")
    for name in ("ingest", "plan", "layers"):
        (root / name).mkdir()
    ingest.run(ingest.Inputs(tiny_ball, root / "ingest"), ingest.IngestConfig())
    views, mesh = root / "ingest/views.json", root / "ingest/mesh.ply"
    settings = plan.PlanConfig(oversampling=0.7, residuals="always", k=1 / 8, samples=2000)
    plan.run(plan.Inputs(views, mesh, 0, root / "plan"), settings)
    layers.run(layers.Inputs(views, mesh, root / "plan/plan.json", root / "layers"), layers.LayersConfig())
    return Sources(views, mesh, root / "plan/plan.json", root / "layers")


def build(sources: Sources, out: Path, **settings: object) -> dict:
    out.mkdir(exist_ok=True)
    inputs = residuals.Inputs(sources.views, sources.mesh, sources.plan, sources.layers, out)
    summary = residuals.run(inputs, ResidualsConfig(**settings)).residuals_document
    return json.loads(summary.read_text(encoding="utf-8"))


def test_refinement_brings_the_training_photos_nearer(sources: Sources, tmp_path: Path) -> None:
    published = build(sources, tmp_path / "a", refine=0)["training_psnr"]
    refined = build(sources, tmp_path / "b", refine=2)["training_psnr"]
    assert len(published) == 1
    assert refined[0] == published[0]
    assert refined[0] + 0.5 < refined[1] < refined[2]
    assert not list((tmp_path / "b").glob("*.npy"))  # the errors handed to the units are gone
    assert not list((tmp_path / "b").glob("*.partial"))  # and the scratch files


@pytest.fixture(scope="module")
def inline(sources: Sources, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Residuals made in place, with memory to spare."""
    folder = tmp_path_factory.mktemp("inline")
    build(sources, folder, quality=100)
    return folder


def assert_same_files(one: Path, other: Path) -> None:
    found = sorted(path.relative_to(one) for path in one.rglob("*.*"))
    assert len(found) == 7  # six textures, one summary
    assert found == sorted(path.relative_to(other) for path in other.rglob("*.*"))
    for path in found:
        assert (one / path).read_bytes() == (other / path).read_bytes()


def small_units(monkeypatch: pytest.MonkeyPatch) -> None:
    for module in (spiral, coding):
        monkeypatch.setattr(module, "UNIT", 3000)


def test_bytes_do_not_depend_on_the_executor(
    sources: Sources, inline: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    small_units(monkeypatch)
    with executor(3):
        build(sources, tmp_path / "threads", quality=100)
    assert_same_files(inline, tmp_path / "threads")


def test_bytes_do_not_depend_on_the_memory(
    sources: Sources, inline: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sample_sets, "TEXEL_BYTES", 1e6)  # so that hardly a texel fits: every photo by itself
    small_units(monkeypatch)
    monkeypatch.setattr(spiral_images_module, "BAND", 600)
    build(sources, tmp_path / "scarce", quality=100, memory_mb=16)
    assert_same_files(inline, tmp_path / "scarce")


def test_batches_hold_what_fits_and_every_photo_once(sources: Sources) -> None:
    context = context_of(sources)
    samples = [sample(sources, which, ResidualsConfig()) for which in (0, 1)]
    whole = sum(len(s.difference) for s in samples)
    ((every, textures),) = in_batches(context, samples, True, whole * sample_sets.TEXEL_BYTES)
    assert list(every) == list(range(len(context.photos.cameras)))
    errors, psnr = photo_errors(context, textures)
    few = list(in_batches(context, samples, True, whole * sample_sets.TEXEL_BYTES // 2))
    assert len(few) > 1
    assert [p for photos, _ in few for p in photos] == list(every)
    assert all(sum(len(t.residuals.texels) for t in part) <= whole // 2 for photos, part in few if len(photos) > 1)
    again, psnr_again = errors_in_batches(context, few)
    np.testing.assert_array_equal(again, errors)
    assert psnr_again == psnr
    forget()


def test_a_unit_takes_paths_and_numbers_and_gives_the_same_in_another_process(sources: Sources) -> None:
    here = sample_images(sources, 1, True, 2, 4)
    assert len(pickle.dumps((sources, 1, True, 2, 4))) < 2000
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        there = pool.submit(sample_images, sources, 1, True, 2, 4).result()
    for one, other in zip(here, there, strict=True):
        np.testing.assert_array_equal(one, other)
    assert np.isfinite(here[0]).any()


def test_changed_sources_are_loaded_anew(sources: Sources) -> None:
    before = context_of(sources)
    assert context_of(sources) is before
    sources.plan.touch()
    assert context_of(sources) is not before
    forget()


def test_no_residuals_leave_the_photo_minus_the_diffuse_colour(sources: Sources) -> None:
    context = context_of(sources)
    samples = sample(sources, 0, ResidualsConfig())
    samples.difference[samples.valid] = 0.0
    none = [SpiralTexture(context.layers[0], uncoded(context, samples, True))]
    errors, psnr = photo_errors(context, none)
    photos = context.photos
    assert (errors[(photos.mask < 0.5) | ~np.isfinite(photos.depth)] == 0).all()
    hits = context.caster.cast_camera(photos.cameras[0])
    row, column = (int(index[len(index) // 2]) for index in np.nonzero(np.isfinite(hits.t)))
    ray = np.array([column + 0.5, row + 0.5, 1.0]) @ photos.cameras[0].world_from_pixel.T
    point = photos.cameras[0].center + float(hits.t[row, column]) * ray
    normal = context.caster.smooth_normals(hits.face[row, column][None], hits.uv[row, column][None])
    diffuse = srgb_encode(context.diffuse.at(point[None], normal)[0])
    pixel = row * photos.cameras[0].width + column
    np.testing.assert_allclose(errors[pixel], photos.code[pixel] - diffuse, atol=2e-4)
    counted = np.abs(errors).max(axis=1) > 0
    assert psnr == pytest.approx(-10 * np.log10((errors[counted] ** 2).mean()), abs=0.1)
    forget()


def test_half_floats_are_linear_differences() -> None:
    rng = np.random.default_rng(4)
    base, seen = rng.random((50, 3)).astype(np.float32), rng.random((50, 3)).astype(np.float32)
    difference = srgb_encode(seen) - srgb_encode(base)
    difference[7] = np.nan
    texels, valid, zero, clamped = code(Samples(0, difference, base), ResidualsConfig(encoding="half"))
    assert (zero, clamped) == (0, 0)
    assert np.flatnonzero(~valid).tolist() == [7]
    assert (texels[7] == 0).all()
    np.testing.assert_allclose(texels[valid], (seen - base)[valid], atol=1e-3)
    np.testing.assert_allclose(srgb_decode(srgb_encode(base[valid]) + difference[valid]), seen[valid], atol=1e-5)


@pytest.mark.parametrize("zero", ["auto", 32])
def test_eight_bits_count_what_they_clamp(zero: int | str) -> None:
    steps = np.array([[-60, 0, 0], [-40, 5, 5], [-33, 0, 0], [0, 250, 0], [100, 3, 2]], np.float32)
    steps = np.concatenate([steps, np.full((1, 3), np.nan, np.float32)])
    texels, valid, offset, count = code(Samples(0, steps / 255, None), ResidualsConfig(zero=zero))
    assert valid.tolist() == [True] * 5 + [False]
    assert (texels[-1] == offset).all()
    if zero == 32:
        assert (offset, count) == (32, 4)  # -60, -40 and -33 fall below 0, 250 rises above 255
    else:
        assert count == 1  # -60 to 250 span more than a byte: one of the two must go
    inside = (steps[:5] + offset >= 0) & (steps[:5] + offset <= 255)
    np.testing.assert_array_equal(texels[:5][inside], (steps[:5] + offset)[inside])


def test_chunks_cover_every_image_once() -> None:
    rng = np.random.default_rng(0)
    for most in (1, 100, 5000, 10**9):
        images = [SpiralImage(np.zeros(3), int(h), int(w)) for h, w in rng.integers(1, 40, (60, 2))]
        runs = chunks(images, most)
        assert [i for first, last in runs for i in range(first, last)] == list(range(60))
        assert all(last > first for first, last in runs)
        assert all(sum(image.texels for image in images[a:b]) <= most + 40 * 40 for a, b in runs)


def test_the_published_spiral_has_fewer_images(sources: Sources) -> None:
    texture = read_plan(sources.plan)[0]
    closed, published = (spiral_images(texture, which) for which in (True, False))
    assert len(closed[1]) == len(closed[0]) > len(published[0])
    planned = spiral_of(texture)
    doubled = planned.model_copy(update={"residual_scale": 2 * planned.residual_scale})
    finer = spiral_images(replace(texture, components=(doubled,)), True)[1]
    assert finer[0].texels == pytest.approx(4 * closed[1][0].texels, rel=0.05)


def test_written_residuals_hold_the_settings(sources: Sources, tmp_path: Path) -> None:
    figures = build(sources, tmp_path / "out", closed=False, encoding="half", refine=1)["textures"]
    for figure in figures:
        read = read_residuals(tmp_path / "out" / f"texture_{figure['texture']:02d}" / "residuals.zip")
        assert not read.closed
        assert read.texels.dtype == np.float32
        assert int(read.valid.sum()) == round(figure["valid_share"] * figure["texels"])
