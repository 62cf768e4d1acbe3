"""The plan: matt scenes get no residuals, glossy ones do, unseen faces are dropped, every choice has its reason."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from ibrpipe.embree import MeshCaster
from ibrpipe.errors import CaptureError, FormatError
from ibrpipe.io.documents.plan import PlannedComponent
from ibrpipe.modelling.appearance import Appearance, beyond_shift, edge_share
from ibrpipe.modelling.plan_file import read_plan
from ibrpipe.modelling.planning import PlanConfig, choose_coverage, choose_residuals, make_plan
from ibrpipe.modelling.rectangles import RectangleConfig
from ibrpipe.stages.plan import Inputs, run

QUICK = PlanConfig(samples=4000, reflection="never", directions="spiral")
#: stands in front of the wall of the matt scene, looking along +y
FRONT = RectangleConfig(name="front", origin=(-1.6, -1, 1.2), u=(3.2, 0, 0), v=(0, 0, -2.4), center=(0, -5, 0))


def by_name(reasons):
    return {entry["what"]: entry for entry in reasons}


@pytest.fixture(scope="module")
def plans(measured):
    found = {name: make_plan(measured(name).caster, measured(name).photos, QUICK, 0) for name in ("lambert", "glossy")}
    return {name: (textures, by_name(reasons)) for name, (textures, reasons) in found.items()}


def test_a_matt_scene_gets_no_residuals_and_the_reason_is_written(plans):
    textures, reasons = plans["lambert"]
    assert not any(texture.components for texture in textures)
    for texture in textures:
        entry = reasons[f"residuals of {texture.rectangle.name}"]
        assert entry["choice"] is False
        assert "would be visible" in entry["reason"] or "too little of the photos" in entry["reason"]
    front = reasons["residuals of -y"]
    assert "diffuse colour predicts left-out photos to" in front["reason"]
    assert front["measured"]["blocks"] > 500
    assert front["measured"]["diffuse_psnr"] > 38


def test_a_glossy_scene_gets_residuals(plans):
    textures, reasons = plans["glossy"]
    modelled = [texture.rectangle.name for texture in textures if texture.component("spiral")]
    assert len(modelled) >= 3  # of the five that are looked through; 14 photos cannot tell for all of them
    assert reasons["residuals of -z"]["measured"]["blocks"] == 0  # no photo looks up through the bottom
    assert "-z" not in modelled
    for name in modelled:
        entry = reasons[f"residuals of {name}"]
        assert "view-dependent colour predicts them" in entry["reason"]
        assert entry["measured"]["gain_db"] >= 0.5


def test_a_glossy_scene_may_keep_its_photos_instead(measured):
    scene = measured("glossy")
    kinds = {}
    for directions in ("photos", "auto"):
        textures, _ = make_plan(scene.caster, scene.photos, QUICK.model_copy(update={"directions": directions}), 0)
        kinds[directions] = {part.kind for texture in textures for part in texture.components}
    assert kinds == {"photos": {"photos"}, "auto": {"photos"}}  # 14 small photos: fewer bytes than spirals
    always = QUICK.model_copy(update={"directions": "auto", "residuals": "always"})
    assert all(each.component("spiral") for each in make_plan(scene.caster, scene.photos, always, 0)[0])
    named = QUICK.model_copy(
        update={"residuals": "always", "components": (PlannedComponent(kind="photos", blended=3),)}
    )
    for texture in make_plan(scene.caster, scene.photos, named, 0)[0]:
        assert [part.model_dump() for part in texture.components] == [{"kind": "photos", "blended": 3}]


def test_a_surface_that_is_slightly_off_is_not_taken_for_gloss(measured):
    """The matt wall, waved by a good half of a pixel: view-dependent colour helps, yet there is none."""
    scene = measured("lambert")
    pixel = np.linalg.norm(scene.photos.centers[0]) / scene.photos.cameras[0].K[0, 0]
    vertices = scene.caster.mesh.vertices.copy()
    vertices[:, 1] += 1.5 * pixel * np.sin(3 * vertices[:, 0]) * np.cos(4 * vertices[:, 2])
    waved = MeshCaster(replace(scene.caster.mesh, vertices=vertices))
    found = by_name(make_plan(waved, scene.photos, QUICK, 0)[1])["residuals of -y"]
    trusting = by_name(make_plan(waved, scene.photos, QUICK.model_copy(update={"shift": 0.0}), 0)[1])["residuals of -y"]
    assert trusting["choice"] is True
    assert trusting["measured"]["beyond_shift_codes"] == trusting["measured"]["diffuse_codes"]
    assert found["choice"] is False
    assert "colours misplaced by up to 1.0 pixels explain all but" in found["reason"]
    assert found["measured"]["beyond_shift_codes"] < 0.5 * found["measured"]["diffuse_codes"]


def test_gloss_is_hardly_explained_by_misplaced_colours(plans):
    for texture in plans["glossy"][0]:
        if texture.component("spiral"):
            figures = plans["glossy"][1][f"residuals of {texture.rectangle.name}"]["measured"]
            assert figures["diffuse_codes"] > figures["beyond_shift_codes"] > 0.4 * figures["diffuse_codes"]


def test_beyond_shift_of_a_pattern_and_of_a_highlight():
    """An edge half a pixel off is all explained; a highlight twelve codes high is not, up to its slope."""
    x = np.arange(20.0)
    edge = np.repeat(np.clip(x - 9.0, 0, 1)[None, :, None], 16, axis=0).repeat(3, axis=2).astype(np.float32)
    pixels = np.arange(16 * 20)
    expected = np.repeat(np.clip(x - 9.5, 0, 1)[None, :, None], 16, axis=0).repeat(3, axis=2).reshape(-1, 3)
    np.testing.assert_allclose(beyond_shift(expected.astype(np.float32), edge, pixels, 1.0), 0, atol=1e-6)
    assert np.abs(beyond_shift(expected.astype(np.float32), edge, pixels, 0.0)).max() == pytest.approx(0.5)
    light = (12 / 255) * np.exp(-(((x - 10) / 5) ** 2))[None, :, None] + np.zeros((16, 1, 3))
    beyond = beyond_shift(np.zeros((320, 3), np.float32), light.astype(np.float32), pixels, 1.0).reshape(light.shape)
    assert (beyond <= light + 1e-6).all()
    assert np.sqrt((beyond**2).mean() / (light**2).mean()) > 0.8


@pytest.mark.parametrize("scene", ["lambert", "glossy"])
def test_every_choice_has_a_reason_with_figures(plans, scene):
    textures, reasons = plans[scene]
    names = [texture.rectangle.name for texture in textures]
    wanted = {"rectangles", "texel", "k", "coverage of rims"} | {
        f"{kind} {name}" for kind in ("layers of", "residuals of") for name in names
    }
    wanted |= {f"texture {mark}{axis}" for mark in "+-" for axis in "xyz"}
    assert set(reasons) == wanted
    for entry in reasons.values():
        assert entry["reason"]
        assert entry["measured"]
    json.dumps(list(reasons.values()))


def test_faces_that_no_photo_sees_are_dropped(measured):
    ball = measured("ball")
    side = np.argsort(-ball.photos.centers[:, 0])[:2]  # photos from +x only
    textures, reasons = make_plan(ball.caster, ball.photos.subset(side), QUICK, 0)
    kept = {texture.rectangle.name for texture in textures}
    assert "+x" in kept
    assert "-x" not in kept
    entry = by_name(reasons)["texture -x"]
    assert entry["choice"] == "dropped"
    assert entry["measured"]["seen_by_a_photo"] == 0
    assert "layers of -x" not in by_name(reasons)


def test_texel_follows_the_photos_own_density(plans, measured):
    _, reasons = plans["lambert"]
    texel = reasons["texel"]["choice"]
    camera = measured("lambert").photos.cameras[0]
    distance = np.linalg.norm(camera.center)
    assert texel == pytest.approx(distance / camera.K[0, 0] / 1.05, rel=0.2)
    finer, _ = make_plan(
        measured("lambert").caster, measured("lambert").photos, PlanConfig(samples=4000, oversampling=2.1), 0
    )
    coarse = plans["lambert"][0]
    assert finer[0].rectangle.width == pytest.approx(2 * coarse[0].rectangle.width, rel=0.1)


def test_settings_overrule_the_measurement(measured):
    ball = measured("ball")
    config = PlanConfig(samples=4000, texel=0.1, k=1 / 24, residuals="never", max_layers=1, rectangles=(FRONT,))
    (texture,), reasons = make_plan(ball.caster, ball.photos, config, 0)
    assert (texture.rectangle.width, texture.rectangle.height) == (32, 24)
    assert (by_name(reasons)["k"]["choice"], texture.components, texture.max_layers) == (1 / 24, (), 1)
    for what in ("texel", "k", "residuals of front"):
        assert by_name(reasons)[what]["reason"] == "set by the pipeline file"


def test_the_seed_decides(measured):
    ball = measured("ball")
    one, other, third = (make_plan(ball.caster, ball.photos, QUICK, seed)[1] for seed in (0, 0, 1))
    assert one == other
    assert one != third


@pytest.mark.parametrize(
    ("found", "choice", "why"),
    [
        (Appearance(5, 0.01, 0.01, 0.01), False, "too little of the photos"),
        (Appearance(500, 1e-4, 1e-4, 1e-4), False, "4.0 would be visible"),
        (Appearance(500, 4e-3, 4e-3, 0.0), False, "0.00 dB better, less than the 0.5 dB"),
        (Appearance(500, 4e-3, 4e-3, 2e-3), True, "1.25 dB better, at least the 0.5 dB"),
        (Appearance(500, 4e-3, 4e-3, 2e-3, 2e-4), True, "by 3.6 if colours may be misplaced"),
        (Appearance(500, 4e-3, 4e-3, 2e-3, 1e-4), False, "explain all but 2.6, less than the 3.0 asked for"),
    ],
)
def test_when_residuals_pay(found, choice, why):
    decided, entry = choose_residuals("a", found, PlanConfig())
    assert decided is choice
    assert why in entry["reason"]


def test_appearance_in_closed_form():
    """A prediction that is right by half: adding that half leaves diffuse - common^2 / predicted."""
    found = Appearance(100, 4e-3, 4e-3, 2e-3)
    assert found.share == 0.5
    assert found.remaining == pytest.approx(4e-3 - (2e-3) ** 2 / 4e-3)
    assert Appearance(100, 4e-3, 0.0, 0.0).gain == 0
    assert Appearance(100, 4e-3, 1e-3, -5e-4).remaining == 4e-3


def test_run_writes_what_read_plan_reads(measured, tmp_path):
    folder = measured("glossy").folder
    (tmp_path / "out").mkdir()
    inputs = Inputs(folder / "views.json", folder / "mesh.ply", 0, tmp_path / "out")
    path = run(inputs, QUICK).plan
    first = path.read_bytes()
    textures = read_plan(path)
    assert [t.rectangle.name for t in textures] == [t["name"] for t in json.loads(first)["textures"]]
    assert run(inputs, QUICK).plan.read_bytes() == first


@pytest.mark.parametrize(
    ("text", "match"),
    [("", "not a plan"), ('{"schema": 9}', "schema 9, expected 1"), ('{"schema": 1, "textures": [{}]}', "not a plan")],
)
def test_a_damaged_plan(tmp_path, text, match):
    (tmp_path / "plan.json").write_text(text, encoding="utf-8")
    with pytest.raises(FormatError, match=match):
        read_plan(tmp_path / "plan.json")
    with pytest.raises(FormatError, match="run the plan stage again"):
        read_plan(tmp_path / "none.json")


def test_photos_that_see_nothing_and_rectangles_that_face_nothing(measured):
    ball = measured("ball")
    away = RectangleConfig(name="away", origin=(50, 0, 0), u=(1, 0, 0), v=(0, 1, 0))
    with pytest.raises(CaptureError, match="turn them round or move them"):
        make_plan(ball.caster, ball.photos, PlanConfig(samples=1000, rectangles=(away,)), 0)
    blind = ball.photos.subset([0])
    blind.projection[:, 2] = -1.0  # everything lies behind it
    with pytest.raises(CaptureError, match="no photo sees the mesh"):
        make_plan(ball.caster, blind, PlanConfig(samples=1000), 0)


@pytest.mark.parametrize(("scene", "wanted"), [("foliage", True), ("glossy", False), ("lambert", False)])
def test_rims_have_coverage_where_much_of_the_photos_is_edges(measured, scene, wanted):
    photos = measured(scene).photos
    choice, told = choose_coverage(QUICK, photos)
    assert choice is wanted
    assert told["choice"] is wanted
    assert (told["measured"]["edge_pixels"] > 0.25) is wanted
    for by_hand in ("always", "never"):
        choice, told = choose_coverage(QUICK.model_copy(update={"coverage": by_hand}), photos)
        assert choice is (by_hand == "always")
        assert told["reason"] == "set by the pipeline file"


def test_background_is_no_edge_without_masks(measured):
    """A place without masks: pixels that show no surface count neither as edges nor as pixels."""
    photos = measured("glossy").photos
    masked = replace(photos, mask=np.isfinite(photos.depth).astype(np.float32))
    bare = replace(photos, mask=np.ones_like(photos.mask))
    assert 0.2 < np.isinf(photos.depth).mean() < 0.95
    assert edge_share(bare) == pytest.approx(edge_share(masked), abs=1e-12)
    assert 0.02 < edge_share(bare) < 0.25
