"""The evaluate stage on a tiny capture with a hand-made diffuse asset: layered depth images of three photos' views."""

from __future__ import annotations

import base64
import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest

import ibrpipe
from ibrpipe.capture.photo_set import load_photos
from ibrpipe.embree import MeshCaster
from ibrpipe.errors import FormatError, MissingFileError
from ibrpipe.evaluation.baselines import render_median
from ibrpipe.evaluation.metrics import MetricsModel, mean_scores, read_metrics
from ibrpipe.io.photos.images import read_image
from ibrpipe.io.surfaces.meshes import read_mesh
from ibrpipe.io.views import ViewSet, read_views, write_views
from ibrpipe.stages import evaluate, ingest, render
from ibrpipe.types import Asset, LayeredDepthImage, SpiralTexture

QUICK = evaluate.EvaluateConfig(timing_width=32, timing_repeats=2, timing_views=2, report_views=2)


def layers_of(view, caster, photos):
    """One-layer image of what a photo's camera sees, in median colours."""
    frame = render_median(view.camera, caster, photos)
    hit = frame.alpha > 0
    offsets = np.concatenate([[0], np.cumsum(hit.ravel())])
    height, width = hit.shape
    ends = offsets[width::width, None]
    table = np.concatenate([offsets[:-1].reshape(height, width), ends], axis=1)
    normals = caster.cast_camera(view.camera).normal[hit]
    return SpiralTexture(LayeredDepthImage(view.camera, table, frame.depth[hit], frame.color[hit], normals))


@pytest.fixture(scope="module")
def made(tiny_glossy, tmp_path_factory):
    """Run folder with everything that evaluate reads, evaluated once."""
    out = tmp_path_factory.mktemp("evaluate") / "run"
    for place in ("ingest", "render", "plan", "report"):
        (out / place).mkdir(parents=True)
    ingest.run(ingest.Inputs(capture=tiny_glossy, out=out / "ingest"), ingest.STAGE.config())
    views = read_views(out / "ingest/views.json")
    caster = MeshCaster(read_mesh(out / "ingest/mesh.ply"))
    photos = load_photos(views.train, caster)
    asset = Asset(tuple(layers_of(view, caster, photos) for view in views.train[::5]))
    ibrpipe.write_asset(asset, out / "asset")
    render.run(
        render.Inputs(asset=out / "asset", views=out / "ingest/views.json", out=out / "render"),
        render.RenderConfig(repeats=1),
    )
    reason = {"what": "k <&>", "choice": 0.5, "reason": "because", "measured": {"angle_deg": 2.5}}
    (out / "plan/plan.json").write_text(json.dumps({"schema": 1, "textures": [], "reasons": [reason]}))
    evaluate.run(inputs_of(out), QUICK)
    return out


def inputs_of(folder, **changes):
    places = {
        "asset": folder / "asset",
        "views": folder / "ingest/views.json",
        "mesh": folder / "ingest/mesh.ply",
        "frames": folder / "render",
        "out": folder / "report",
        "run": folder,
        "plan": folder / "plan/plan.json",
    }
    return evaluate.Inputs(**{**places, **changes})


@pytest.fixture(scope="module")
def metrics(made):
    return read_metrics(made / "report/metrics.json")


@pytest.fixture(scope="module")
def page(made):
    return (made / "report/report.html").read_text(encoding="utf-8")


def test_metrics_have_the_promised_keys(made):
    document = json.loads((made / "report/metrics.json").read_text(encoding="utf-8"))
    assert {"views", "mean", "renderers", "baselines", "bytes", "seconds", "machine"} <= document.keys()
    mean = {"psnr", "ssim", "flip", "depth_rmse", "coverage", "ms_per_frame", "mpix_per_s"}
    for scores in (document["mean"], *document["renderers"].values(), *document["baselines"].values()):
        assert mean <= scores.keys()
    assert set(document["baselines"]) == {"diffuse", "ulr", "mesh"}
    assert document["mean"] == document["renderers"]["ldi"]
    MetricsModel.model_validate(document)


def test_means_are_those_of_the_views(metrics):
    assert len(metrics.views) == 3
    for name in metrics.baselines:
        expected = mean_scores([view.baselines[name] for view in metrics.views])
        assert metrics.baselines[name].psnr == expected.psnr
        assert metrics.baselines[name].depth_rmse == expected.depth_rmse


def test_an_asset_without_residuals_is_its_own_diffuse_baseline(metrics):
    for view in metrics.views:
        assert view.renderers["ldi"] == view.baselines["diffuse"]


def test_scores_lie_where_they_should(metrics):
    ulr, mesh, own = metrics.baselines["ulr"], metrics.baselines["mesh"], metrics.mean
    assert 15 < mesh.psnr < ulr.psnr < 45  # a glossy thing: the lumigraph is better than any diffuse mesh
    assert 10 < own.psnr < mesh.psnr + 1
    assert ulr.coverage > 0.97
    assert 0.5 < own.coverage <= 1
    assert ulr.depth_rmse < 0.05
    assert 0 < ulr.flip < mesh.flip < 0.5
    for view in metrics.views:
        assert 0 < view.highlight_pixels < view.mask_pixels


def test_times_and_speeds_agree(metrics):
    pixels = metrics.protocol.timing_width * metrics.protocol.timing_height
    for scores in (*metrics.renderers.values(), *metrics.baselines.values()):
        assert scores.ms_per_frame > 0
        assert scores.mpix_per_s == pytest.approx(pixels / (1e3 * scores.ms_per_frame))


def test_bytes_are_those_on_disk(made, metrics):
    asset = sum(path.stat().st_size for path in (made / "asset").rglob("*") if path.is_file())
    assert metrics.bytes["asset"] == asset
    assert metrics.bytes["layers"] + metrics.bytes["residuals"] + metrics.bytes["asset_other"] == asset
    assert metrics.bytes["residuals"] == 0 < metrics.bytes["layers"]
    photos = [view.image for view in read_views(made / "ingest/views.json").train]
    assert metrics.bytes["photos"] == sum(path.stat().st_size for path in photos)
    assert metrics.bytes["mesh"] == (made / "ingest/mesh.ply").stat().st_size


def test_seconds_come_from_the_manifests(made, tmp_path):
    from ibrpipe.evaluation.sizes import seconds_of

    assert seconds_of(None, "evaluate") == {}
    assert seconds_of(made, "evaluate") == {}  # made without the runner
    manifest = {
        "stage": "layers", "key": "", "config": {}, "inputs": {}, "upstream": {}, "code": "", "versions": {},
        "files": {}, "seconds": 1.5, "peak_memory_bytes": None,
    }  # fmt: skip
    (tmp_path / "layers").mkdir()
    (tmp_path / "layers/manifest.json").write_text(json.dumps(manifest))
    (tmp_path / "odd").mkdir()
    (tmp_path / "odd/manifest.json").write_text("not ours")
    assert seconds_of(tmp_path, "evaluate") == {"layers": 1.5}
    assert seconds_of(tmp_path, "layers") == {}


def test_the_report_loads_nothing_from_anywhere(page):
    assert not re.search(r"""(src|href)\s*=\s*["']?\s*(https?:)?//""", page)
    assert not re.search(r"url\(\s*['\"]?(?!#)", page)
    assert page.count("<script") == page.count("<script>") == 1  # its own, which enlarges pictures
    assert not re.search(r"fetch\(|XMLHttpRequest|WebSocket|import\(|sendBeacon", page)
    assert "<link" not in page
    assert "@import" not in page


def test_the_report_shows_its_pictures(page):
    found = re.findall(r'src="data:image/jpeg;base64,([^"]+)"', page)
    assert len(found) == 2 * (2 + 2 * 2)  # views: photo, highlights, asset, lumigraph, differences
    assert all(base64.b64decode(text)[:3] == b"\xff\xd8\xff" for text in found)
    assert page.count("<svg") == 1


def test_the_report_tells_the_figures_and_the_reasons(page, metrics):
    assert f"{metrics.mean.psnr:.2f}" in page
    assert f"{metrics.baselines['ulr'].ssim:.4f}" in page
    assert "k &lt;&amp;&gt;" in page
    assert "angle deg 2.5" in page
    assert "the asset holds no residuals" in page
    for line in ("Held-out photos are used for measuring only", "RaycastingScene", metrics.machine.cpu):
        assert line in page
    for view in metrics.views:
        assert view.name in page


def test_pictures_of_the_report_are_those_of_the_frames(made, page, tmp_path):
    first = re.search(r'<figure><img src="data:image/jpeg;base64,([^"]+)"', page)
    (tmp_path / "photo.jpg").write_bytes(base64.b64decode(first.group(1)))
    shown = read_image(tmp_path / "photo.jpg")
    assert max(shown.shape) <= 96
    assert 0.02 < shown.mean() < 0.98


def test_frames_that_the_render_stage_did_not_make_are_rendered(made, metrics, tmp_path):
    frames = tmp_path / "render"
    shutil.copytree(made / "render", frames)
    document = json.loads((frames / "frames.json").read_text())
    document["frames"][0]["cam_from_world"][0][3] += 0.25  # of another place
    del document["frames"][1]
    (frames / "frames.json").write_text(json.dumps(document))
    (tmp_path / "out").mkdir()
    evaluate.run(inputs_of(made, frames=frames, out=tmp_path / "out", run=None, plan=None), QUICK)
    again = read_metrics(tmp_path / "out/metrics.json")
    assert again.views == metrics.views
    page = (tmp_path / "out/report.html").read_text(encoding="utf-8")
    assert "Why it is built this way" not in page


def test_missing_frames_are_told(made, tmp_path):
    with pytest.raises(MissingFileError, match=r"frames\.json: does not exist; run the render stage first"):
        evaluate.run(inputs_of(made, frames=tmp_path, out=tmp_path), QUICK)


@pytest.mark.parametrize("text", ["{", "[]", '{"frames": [{}], "renderers": ["ldi"]}', '{"frames": []}'])
def test_a_damaged_list_of_frames_is_told(made, tmp_path, text):
    (tmp_path / "frames.json").write_text(text)
    with pytest.raises(FormatError, match=r"frames\.json: is no list of frames"):
        evaluate.run(inputs_of(made, frames=tmp_path, out=tmp_path), QUICK)


def test_a_capture_without_held_out_views_ends_in_a_report_that_says_so(made, tmp_path):
    views = read_views(made / "ingest/views.json")
    write_views(ViewSet(views.train[:5], (), views.mesh, views.info), tmp_path / "views.json")
    told = evaluate.run(inputs_of(made, views=tmp_path / "views.json", out=tmp_path), QUICK)
    found = read_metrics(told.metrics)
    assert found.views == []
    assert found.mean.psnr is None
    assert found.mean.ms_per_frame > 0
    assert found.training is not None
    assert [view.name for view in found.training.views] == [view.name for view in views.train[:5]]
    assert set(found.training.views[0].baselines) == {"diffuse"}  # photos blended would show themselves
    assert found.training.renderers["ldi"].psnr > 10
    (line,) = found.not_measured
    assert "none of the 5 photos is held out" in line
    assert line in told.report.read_text(encoding="utf-8")
    assert line in (tmp_path / "summary.txt").read_text(encoding="utf-8")


def test_without_masks_covered_pixels_come_first_and_uncovered_ones_are_no_highlights(made, tmp_path):
    from dataclasses import replace

    views = read_views(made / "ingest/views.json")
    bare = tuple(replace(view, mask=None, mask_from_alpha=False) for view in views.test)
    write_views(ViewSet(views.train, bare, views.mesh, views.info), tmp_path / "views.json")
    found = read_metrics(evaluate.run(inputs_of(made, views=tmp_path / "views.json", out=tmp_path), QUICK).metrics)
    assert found.headline == "covered"
    masked = read_metrics(made / "report/metrics.json")
    assert masked.headline == "mask"
    for view in found.views:
        assert view.mask_pixels == 96 * 72
        assert view.highlight_pixels < view.covered_pixels < view.mask_pixels
        own = view.renderers["ldi"]
        assert own.psnr_covered > own.psnr + 1  # the bright surroundings are in no method
    assert found.mean.psnr_covered == pytest.approx(masked.mean.psnr_covered, abs=1.5)


@pytest.mark.real
@pytest.mark.parametrize(
    ("capture", "name", "psnr", "within"),
    [
        ("shiny_vase", "ulr", 27.6, 0.3),
        ("shiny_vase", "mesh", 23.1, 0.3),
        ("lambert_relief", "ulr", 39.6, 0.5),
        ("lambert_relief", "mesh", 39.6, 0.3),
    ],
)
def test_baselines_reach_the_reference_on_path_traced_captures(capture, name, psnr, within):
    import os

    from ibrpipe.evaluation.baselines import render_ulr
    from ibrpipe.evaluation.held_out import load_truth
    from ibrpipe.evaluation.image_scores import score_frame

    root = Path(os.environ.get("IBRPIPE_DATA", "")) / "captures" / capture
    if "IBRPIPE_DATA" not in os.environ or not root.is_dir():
        pytest.skip(f"IBRPIPE_DATA does not lead to captures/{capture}")
    found = ibrpipe.read_capture(root)
    caster = MeshCaster(read_mesh(found.mesh))
    photos = load_photos(found.train, caster)
    draw = {"ulr": render_ulr, "mesh": render_median}[name]
    views = [score_frame(load_truth(view), draw(view.camera, caster, photos)) for view in found.test]
    assert mean_scores(views).psnr == pytest.approx(psnr, abs=within)
