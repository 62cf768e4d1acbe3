"""The asset stage: what it copies, what its index says, and that the result renders."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

import ibrpipe
from ibrpipe.engine.artifacts import needs
from ibrpipe.errors import IbrError
from ibrpipe.io.assets import listed_files, read_asset, read_index
from ibrpipe.io.views import ViewSet, read_views, write_views
from ibrpipe.modelling.plan_file import read_plan
from ibrpipe.stages import asset, layers, plan, residuals
from ibrpipe.stages.registry import load_stages


@pytest.fixture(scope="module")
def made(measured, tmp_path_factory):
    """A glossy asset made coarsely: the folder that holds every stage's results."""
    folder = tmp_path_factory.mktemp("asset")
    source = measured("glossy").folder
    views, mesh = source / "views.json", source / "mesh.ply"
    for name in ("plan", "layers", "residuals", "asset"):
        (folder / name).mkdir()
    config = plan.PlanConfig(samples=2000, texel=0.12, k=1 / 4, directions="spiral")
    plan.run(plan.Inputs(views, mesh, 0, folder / "plan"), config)
    planned = folder / "plan" / "plan.json"
    layers.run(layers.Inputs(views, mesh, planned, folder / "layers"), layers.LayersConfig())
    residuals.run(
        residuals.Inputs(views, mesh, planned, folder / "layers", folder / "residuals"),
        residuals.ResidualsConfig(refine=0),
    )
    inputs = asset.Inputs(views, planned, folder / "layers", folder / "residuals", folder / "asset")
    asset.run(inputs, asset.AssetConfig(units="metre"))
    return folder, inputs


def test_the_index_tells_what_was_made(made):
    folder, _ = made
    index, plans = read_index(folder / "asset"), read_plan(folder / "plan" / "plan.json")
    assert index.units == "metre"
    assert len(index.provenance["photos"]) == 14
    assert len(index.provenance["held_out"]) == 3
    assert index.provenance["reasons"] == json.loads((folder / "plan" / "plan.json").read_text())["reasons"]
    assert [t.name for t in index.textures] == [p.rectangle.name for p in plans]
    assert [bool(t.components) for t in index.textures] == [bool(p.components) for p in plans]
    assert any(p.components for p in plans)
    for entry, planned in zip(index.textures, plans):
        assert entry.measured["layers"]["name"] == entry.name
        assert (entry.measured["residuals"] is not None) == bool(planned.components)


def test_files_are_copied_whole(made):
    folder, _ = made
    for file in (folder / "asset").rglob("texture_*/*"):
        kind = "layers" if file.name == "layers.exr" else "residuals"
        assert file.read_bytes() == (folder / kind / file.parent.name / file.name).read_bytes()


def test_the_asset_renders_and_residuals_matter(made, measured):
    asset_read = read_asset(made[0] / "asset")
    camera = measured("glossy").photos.cameras[0].resized(48, 36)
    matt, full = (ibrpipe.render(asset_read, camera, residuals=choice) for choice in (False, True))
    np.testing.assert_array_equal(matt.depth, full.depth)
    hit = np.isfinite(full.depth)
    truth = measured("glossy").caster.cast_camera(camera).t
    assert (hit == np.isfinite(truth)).mean() > 0.9
    assert np.abs(full.color - matt.color)[hit].mean() > 0.005
    assert (full.color[~hit] == 0).all()


@pytest.mark.parametrize("name", ["layers/texture_00/layers.exr", "residuals/residuals.json", "layers/layers.json"])
def test_a_missing_part_is_named(made, tmp_path, name):
    import shutil

    folder, inputs = made
    copy = tmp_path / "run"
    shutil.copytree(folder, copy)
    (copy / name).unlink()
    moved = asset.Inputs(inputs.views, copy / "plan/plan.json", copy / "layers", copy / "residuals", copy / "asset")
    with pytest.raises((IbrError, FileNotFoundError), match=name.rsplit("/", 1)[1]):
        asset.run(moved, asset.AssetConfig())


def test_the_stage_is_wired():
    assert asset.STAGE.name == "asset"
    assert needs(asset.STAGE, load_stages()) == ("geometry", "photometry", "plan", "layers", "residuals")


def test_a_background_is_a_texture_behind_the_rest(made, measured, tmp_path):
    source = measured("glossy").folder
    views = read_views(source / "views.json")
    bare = tuple(replace(view, mask=None, mask_from_alpha=False) for view in views.train)
    write_views(ViewSet(bare, (), views.mesh, views.info), tmp_path / "views.json")
    inputs = replace(made[1], views=tmp_path / "views.json", out=tmp_path / "asset", mesh=source / "mesh.ply")
    (tmp_path / "asset").mkdir()
    asset.run(inputs, asset.AssetConfig(background="plane"))
    plain, whole = read_asset(made[0] / "asset"), read_asset(tmp_path / "asset")
    far = [entry.name for entry in read_index(tmp_path / "asset").textures if entry.name.startswith("background")]
    assert far == [f"background {number + 1}" for number in range(len(whole.textures) - len(plain.textures))]
    assert "far plane" in (tmp_path / "asset/summary.txt").read_text(encoding="utf-8")
    camera = views.train[0].camera
    before, after = ibrpipe.render(plain, camera), ibrpipe.render(whole, camera)
    assert before.alpha.mean() < 0.7
    assert after.alpha.mean() > 0.95
    near = before.alpha >= 0.5
    np.testing.assert_allclose(after.depth[near], before.depth[near], rtol=1e-5)
    assert np.array_equal(whole.bounds, plain.bounds)  # orbits stay where they were
    files = {path.relative_to(tmp_path / "asset").as_posix() for path in (tmp_path / "asset").rglob("*.*")}
    assert files - listed_files(tmp_path / "asset") == {"summary.txt"}


def test_masked_photos_have_no_background_and_that_is_told(made, measured, tmp_path):
    source = measured("glossy").folder
    (tmp_path / "asset").mkdir()
    inputs = replace(made[1], out=tmp_path / "asset", mesh=source / "mesh.ply")
    asset.run(inputs, asset.AssetConfig(background="plane"))
    assert len(read_asset(tmp_path / "asset").textures) == len(read_asset(made[0] / "asset").textures)
    assert "no background: the photos show next to nothing" in (tmp_path / "asset/summary.txt").read_text()


def test_components_of_any_kind_are_gathered(made, tmp_path):
    """Files, what is shared, figures by kind, and layers that a fitter has written anew."""
    import shutil

    folder, inputs = made
    copy = tmp_path / "residuals"
    shutil.copytree(folder / "residuals", copy)
    summary = json.loads((copy / "residuals.json").read_text(encoding="utf-8"))
    tint = {"kind": "tint", "files": ["texture_00/a.bin", "texture_00/b.bin"], "strength": 0.5}
    summary["textures"].append({"name": "front", "texture": 0, "bytes": 2, "component": tint, "gain": 1.5})
    summary["shared"] = [{"kind": "tint", "file": "book.bin"}]
    (copy / "residuals.json").write_text(json.dumps(summary), encoding="utf-8")
    (copy / "texture_00").mkdir(exist_ok=True)
    for number, name in enumerate(("texture_00/a.bin", "texture_00/b.bin", "book.bin", "texture_00/layers.exr")):
        (copy / name).write_bytes(bytes([number]))
    out = tmp_path / "asset"
    out.mkdir()
    asset.run(asset.Inputs(inputs.views, inputs.plan, inputs.layers, copy, out), asset.AssetConfig())
    index, before = read_index(out), read_index(folder / "asset")
    entry = index.textures[0]
    assert entry.components[:-1] == before.textures[0].components
    assert entry.components[-1].model_dump() == tint | {"files": tuple(tint["files"])}
    assert entry.measured["tint"] == {"name": "front", "texture": 0, "bytes": 2, "gain": 1.5}
    assert entry.measured["residuals"] == before.textures[0].measured["residuals"]
    assert [component.model_dump() for component in index.shared] == summary["shared"]
    for number, name in enumerate(("texture_00/a.bin", "texture_00/b.bin", "book.bin", "texture_00/layers.exr")):
        assert (out / name).read_bytes() == bytes([number])
    kept = "texture_01/layers.exr"
    assert (out / kept).read_bytes() == (folder / "layers" / kept).read_bytes()
