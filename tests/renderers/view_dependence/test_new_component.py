"""A kind of view dependence made by following ``docs/new-component.md``: its lines are run as they stand there."""

from __future__ import annotations

import json
import re
import sys
import types
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import ibrpipe
from ibrpipe.core.spiral import directions
from ibrpipe.io import components
from ibrpipe.types import LayeredDepthImage, ParallelFrame, SpiralResiduals, Texture

PAGE = Path(ibrpipe.__file__).parent.parent / "docs" / "new-component.md"
FRAME = ParallelFrame((0, 0, 0), (0.5, 0, 0), (0, 0.5, 0), (0, 0, 1))
EDGES = ParallelFrame((0, 0, 0), (2, 0, 0), (0, 2, 0), (0, 0, 1))
CAMERA = ibrpipe.Camera.look_at((1.4, 0.7, -4), (1, 1, 1), fov_y_deg=40, width=24, height=20)


@pytest.fixture
def tint(monkeypatch):
    """The module of the page, its kind registered for one test."""
    monkeypatch.setattr(components, "_known", dict(components._known))
    module = types.ModuleType("tint")
    monkeypatch.setitem(sys.modules, "tint", module)
    source = re.search(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    exec(compile(source[1], str(PAGE), "exec"), module.__dict__)
    return module


def layers(depth=1.0, frame=FRAME):
    grid = np.full((16, 3), (0.0, 0.0, -1.0))
    offsets = np.arange(4)[:, None] * 4 + np.arange(5)
    return LayeredDepthImage(frame, offsets, np.full(16, depth), np.full((16, 3), 0.25), grid, np.ones(16, np.int32))


def spiral(code=52):
    alphas = directions.table(1 / 4, True)
    count, ways = len(alphas), directions.directions(alphas, 1 / 4, directions.LIMIT)
    texels = np.full((count, 3), code, np.uint8)
    sizes = np.ones((count, 2), np.int32)
    return SpiralResiduals(EDGES, 1 / 4, alphas, ways, sizes, np.arange(count + 1), texels, np.ones(count, bool))


def written(folder, *textures):
    ibrpipe.write_asset(ibrpipe.Asset(textures), folder)
    return ibrpipe.read_asset(folder)


def test_it_is_written_and_read_beside_a_spiral(tint, tmp_path):
    asset = written(tmp_path / "asset", Texture(layers(), (spiral(), tint.Tint(0.5))), Texture(layers(2.0)))
    assert asset.kinds == ("spiral", "tint")
    assert asset.textures[0].component("tint") == tint.Tint(0.5)
    assert (asset.textures[0].residuals.texels == 52).all()
    assert asset.textures[1].components == ()
    index = json.loads((tmp_path / "asset" / "asset.json").read_text(encoding="utf-8"))
    assert index["textures"][0]["components"] == [
        {"kind": "spiral", "file": "texture_00/residuals.zip"},
        {"kind": "tint", "file": "texture_00/tint.json"},
    ]
    assert "shared" not in index


def test_ldi_adds_it_after_the_spiral(tint, tmp_path):
    asset = written(tmp_path / "asset", Texture(layers(), (spiral(), tint.Tint(0.5))))
    plain, full = (ibrpipe.render(asset, CAMERA, residuals=choice) for choice in (False, True))
    alone = ibrpipe.render(Texture(layers(), (spiral(),)), CAMERA)
    rays = CAMERA.pixel_rays()
    cosine = rays[..., 2] / np.linalg.norm(rays, axis=-1)
    hit = np.isfinite(full.depth) & (alone.alpha > 0)
    assert hit.sum() > 30
    assert (alone.color - plain.color)[hit].min() > 0.01
    np.testing.assert_allclose(full.color[hit], (alone.color * (1 + 0.5 * cosine[..., None]))[hit], rtol=1e-5)
    np.testing.assert_array_equal(full.color[~hit], alone.color[~hit])
    assert full.stats["tinted"] == hit.sum()
    assert full.stats["without_residual"] == alone.stats["without_residual"]


def test_only_the_texture_that_has_it_changes(tint):
    beside = ParallelFrame((-1.5, 0, 0), (0.5, 0, 0), (0, 0.5, 0), (0, 0, 1))
    plain, tinted = Texture(layers(frame=beside)), Texture(layers(), (tint.Tint(0.5),))
    height = ibrpipe.ReliefTexture(FRAME, np.full((4, 4, 3), 0.25), np.full((4, 4), 5.0))
    lone, both = ibrpipe.render([plain, height], CAMERA), ibrpipe.render([plain, tinted, height], CAMERA)
    same = (both.depth == lone.depth) & (lone.alpha > 0)
    new = (both.alpha > 0) & ~same
    assert same.sum() > 30
    assert new.sum() > 30
    np.testing.assert_array_equal(both.color[same], lone.color[same])
    assert (both.color[new] > 0.3).all()


def test_it_is_told_of_samples_that_are_left_out(tint, monkeypatch):
    told, coverage = [], np.where(np.arange(16) % 3 == 0, 0.2, 0.9)
    monkeypatch.setattr(tint.Tint, "of_samples", lambda self, kept: told.append(kept) or self)
    ibrpipe.prepare(Texture(replace(layers(), coverage=coverage), (tint.Tint(0.5),)), "epipolar")
    np.testing.assert_array_equal(told, [coverage >= 0.5])


def test_the_view_independent_picture_comes_first(tint):
    from ibrpipe.renderers.ldi.progressive import render_progressive

    source = Texture(layers(), (spiral(), tint.Tint(0.5)))
    first, last = render_progressive(source, CAMERA)
    np.testing.assert_array_equal(first.color, ibrpipe.render(source, CAMERA, residuals=False).color)
    np.testing.assert_array_equal(last.color, ibrpipe.render(source, CAMERA).color)


def test_inspect_names_it(tint, tmp_path):
    from ibrpipe.cli.main import cli

    written(tmp_path / "asset", Texture(layers(), (spiral(), tint.Tint(0.5))))
    result = CliRunner().invoke(cli, ["inspect", str(tmp_path / "asset"), "--json"])
    facts = json.loads(result.stdout)
    assert facts["textures"]["texture_00"]["view_dependence"] == "spiral, tint"
    assert set(facts["view_dependence_bytes"]) == {"spiral", "tint"}
    assert facts["view_dependence_bytes"]["tint"] == (tmp_path / "asset/texture_00/tint.json").stat().st_size


def test_without_its_module_the_asset_is_refused_in_one_line(tint, tmp_path, monkeypatch):
    written(tmp_path / "asset", Texture(layers(), (tint.Tint(0.5),)))
    monkeypatch.delitem(components._known, "tint")
    with pytest.raises(
        ibrpipe.IbrError,
        match=r"asset\.json: texture texture_00.*'tint'.*: spiral, reflection, photos; use a newer",
    ) as told:
        ibrpipe.read_asset(tmp_path / "asset")
    assert "\n" not in str(told.value)
    with pytest.raises(ibrpipe.IbrError, match="no view dependence of kind 'tint' is known"):
        ibrpipe.prepare(Texture(layers(), (tint.Tint(0.5),)))


def test_the_pipeline_fits_it(tint, tmp_path):
    from ibrpipe.io.documents.plan import PlannedComponent
    from ibrpipe.modelling.plan_file import TexturePlan, read_plan, write_plan
    from ibrpipe.modelling.rectangles import Rectangle
    from ibrpipe.modelling.view_dependence.residuals_file import read_document
    from ibrpipe.stages import residuals

    rectangle = Rectangle("front", np.zeros(3), np.array([2.0, 0, 0]), np.array([0, 2.0, 0]), 4, 4, None)
    planned = PlannedComponent(kind="tint", strength=0.25)
    write_plan(
        [TexturePlan(rectangle, 60.0, 1), TexturePlan(rectangle, 60.0, 1, (planned,))], [], tmp_path / "plan.json"
    )
    assert read_plan(tmp_path / "plan.json")[1].components == (planned,)
    nowhere, out = tmp_path / "none", tmp_path / "residuals"
    out.mkdir()
    residuals.run(residuals.Inputs(nowhere, nowhere, tmp_path / "plan.json", nowhere, out), residuals.ResidualsConfig())
    document = read_document(out)
    assert document.of_texture(0) == []
    (figures,) = document.of_texture(1)
    assert figures.component.kind == "tint"
    (file,) = figures.component.paths
    assert figures.bytes == (out / file).stat().st_size
    assert json.loads((out / file).read_text()) == {"strength": 0.25}


def test_a_pipeline_file_asks_for_it(tint):
    from ibrpipe.modelling.planning import PlanConfig

    asked = {"components": [{"kind": "tint", "strength": 0.2}]}
    (component,) = PlanConfig.model_validate(asked).components
    assert (component.kind, component.settings) == ("tint", {"strength": 0.2})
    with pytest.raises(ValueError, match="kind 'tint' is planned already"):
        PlanConfig.model_validate({"components": asked["components"] * 2})
    with pytest.raises(ValueError, match="'spiral' is planned already; name each once, the spiral by residuals"):
        PlanConfig.model_validate({"components": [{"kind": "spiral"}]})
    with pytest.raises(ValueError, match="kind 'neural' is known, only: spiral, reflection, photos, tint"):
        PlanConfig.model_validate({"components": [{"kind": "neural"}]})
