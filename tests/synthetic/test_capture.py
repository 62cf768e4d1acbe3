"""Synthetic captures on disk: layout, cameras, determinism, noise, failures."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from ibrpipe.errors import ConfigError
from ibrpipe.io.captures import read_capture
from ibrpipe.io.photos.images import read_coverage, read_image
from ibrpipe.io.surfaces.meshes import read_mesh
from ibrpipe.io.views import load_depth, load_view
from ibrpipe.synthetic.capture import TINY, SynthConfig, plan_views, write_capture
from ibrpipe.synthetic.photograph import measure_truth, take_photo
from ibrpipe.synthetic.rig import photo_directions
from ibrpipe.synthetic.scene import Rig, prepare_scene
from ibrpipe.synthetic.scenes import make_scene, scene_names

SMALL = TINY.model_copy(update={"photos": 4, "tests": 1, "width": 32, "height": 24, "rays": 1, "occlusion_rays": 8})


def files(folder: Path) -> dict[str, bytes]:
    return {
        path.relative_to(folder).as_posix(): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()
    }


def test_the_folder_has_the_layout_of_a_capture(tiny_glossy: Path) -> None:
    found = set(files(tiny_glossy))
    photos = {f"{kind}/{i:03d}.png" for kind in ("images", "masks") for i in range(14)}
    model = {f"sparse/0/{name}.txt" for name in ("cameras", "images", "points3D")}
    tests = {f"test/{kind}/{i:03d}.png" for kind in ("images", "masks", "diffuse") for i in range(3)}
    truth = {f"test/{kind}/{i:03d}.exr" for kind in ("depth", "normals") for i in range(3)}
    half = {"transforms.json", *model}
    assert found == photos | tests | truth | half | {f"test/{name}" for name in half} | {"mesh.ply", "scene.json"}


def test_poses_survive_the_colmap_text(tiny_glossy: Path) -> None:
    staged = prepare_scene(make_scene("glossy", TINY.detail), 0)
    photos, tests = plan_views(staged, TINY)
    capture = read_capture(tiny_glossy)
    for wanted, view in zip([*photos, *tests], [*capture.train, *capture.test], strict=True):
        np.testing.assert_allclose(view.camera.cam_from_world, wanted.cam_from_world, atol=1e-12)
        np.testing.assert_allclose(view.camera.K, wanted.K, rtol=1e-14)
        assert (view.camera.width, view.camera.height) == (96, 72)


def test_the_mesh_file_is_what_was_photographed(tiny_ball: Path) -> None:
    scene = make_scene("ball", TINY.detail)
    mesh = read_mesh(tiny_ball / "mesh.ply")
    np.testing.assert_array_equal(mesh.vertices, scene.parts[0].shape.mesh.vertices.astype(np.float32))
    np.testing.assert_array_equal(mesh.faces, scene.parts[0].shape.mesh.faces)


def test_the_files_hold_what_the_camera_saw(tiny_ball: Path) -> None:
    staged = prepare_scene(make_scene("ball", TINY.detail), TINY.occlusion_rays)
    view = read_capture(tiny_ball).test[1]
    color, mask = load_view(view)
    photo, truth = take_photo(staged, view.camera, TINY.rays), measure_truth(staged, view.camera)
    assert np.abs(mask - photo.coverage).max() <= 0.5 / 255 + 1e-6
    dark = photo.color < 0.5  # half a step of the 8-bit sRGB code is less than 0.004 of linear light there
    assert np.abs(color - photo.color)[dark].max() < 0.004
    np.testing.assert_array_equal(load_depth(view), truth.depth)
    assert (color[photo.color >= 1.0] == 1.0).all()


def test_same_seed_same_bytes_other_seed_other_photos(tmp_path: Path) -> None:
    noisy = SMALL.model_copy(update={"noise": 2.0})
    first, second = (files(write_capture("glossy", tmp_path / name, noisy)) for name in "ab")
    assert first == second
    other = files(write_capture("glossy", tmp_path / "c", noisy.model_copy(update={"seed": 1})))
    assert other.keys() == first.keys()
    assert other["images/000.png"] != first["images/000.png"]
    assert other["sparse/0/images.txt"] != first["sparse/0/images.txt"]
    assert other["mesh.ply"] == first["mesh.ply"]


def test_noise_has_the_size_asked_for_and_spares_the_tests(tmp_path: Path) -> None:
    clean, noisy = (write_capture("ball", tmp_path / f"{n}", SMALL.model_copy(update={"noise": n})) for n in (0.0, 3.0))
    assert (clean / "test/images/000.png").read_bytes() == (noisy / "test/images/000.png").read_bytes()
    assert (clean / "masks/000.png").read_bytes() == (noisy / "masks/000.png").read_bytes()
    before, after = (codes(folder / "images/002.png") for folder in (clean, noisy))
    mid = (before > 30) & (before < 225)
    spread = (after - before)[mid].std()
    assert 2.7 < spread < 3.4


def codes(path: Path) -> np.ndarray:
    """8-bit codes of a picture, float."""
    from ibrpipe.core.color import srgb_encode

    return np.rint(255 * srgb_encode(read_image(path)))


def test_masks_are_full_inside_empty_outside_and_soft_between(tiny_glossy: Path) -> None:
    mask = read_coverage(tiny_glossy / "masks" / "003.png")
    assert (mask == 0).mean() > 0.3
    assert (mask == 1).mean() > 0.1
    soft = (mask > 0) & (mask < 1)
    assert 0 < soft.mean() < 0.2
    assert set(np.rint(mask[soft] * 255)) <= {64, 128, 191}  # quarters, at 2 x 2 rays


@pytest.mark.parametrize("name", scene_names())
def test_no_photo_cuts_the_object_off_and_it_fills_one(name: str) -> None:
    staged = prepare_scene(make_scene(name, 0.3), 0)
    photos, tests = plan_views(staged, SynthConfig(photos=30, tests=7))
    filled = []
    for camera in [*photos, *tests]:
        seen = staged.caster.mesh.vertices @ camera.R.T + camera.t
        pixels = (seen @ camera.K.T)[:, :2] / seen[:, 2:]
        share = np.abs(pixels / (camera.width, camera.height) - 0.5).max() * 2
        assert share < 0.95
        filled.append(share)
    assert max(filled) > 0.93


def test_tests_lie_between_the_rings() -> None:
    staged = prepare_scene(make_scene("glossy", 0.3), 0)
    photos, tests = plan_views(staged, SynthConfig(photos=40, tests=8, jitter_deg=0.0))
    toward = [np.array([c.center / np.linalg.norm(c.center) for c in half]) for half in (photos, tests)]
    nearest = np.degrees(np.arccos(np.clip(toward[1] @ toward[0].T, -1, 1))).min(axis=1)
    assert nearest.min() > 5
    assert nearest.max() < 25


@pytest.mark.parametrize("count", [1, 2, 3, 4, 5, 17, 40, 100])
def test_any_number_of_photos_is_spread_over_the_rings(count: int) -> None:
    directions = np.array(photo_directions(Rig(), count))
    assert directions.shape == (count, 3)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1.0)
    assert len(np.unique(directions.round(9), axis=0)) == count
    if count >= 4:
        assert len(np.unique(directions[:, 2].round(9))) == 4


def test_scene_json_tells_how_it_was_made(tiny_glossy: Path) -> None:
    told = json.loads((tiny_glossy / "scene.json").read_text(encoding="utf-8"))
    assert told["scene"] == "glossy"
    assert SynthConfig(**told["options"]) == TINY
    faces = len(read_mesh(tiny_glossy / "mesh.ply").faces)
    assert told["parts"][0]["faces"][0] == 0
    assert told["parts"][-1]["faces"][1] == faces
    assert told["parts"][0]["faces"][1] == told["parts"][1]["faces"][0]


def test_no_tests_no_test_folder(tmp_path: Path) -> None:
    folder = write_capture("ball", tmp_path / "a", SMALL.model_copy(update={"tests": 0}))
    assert not (folder / "test").exists()


def test_a_folder_that_holds_something_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "kept.txt").write_text("mine")
    with pytest.raises(ConfigError, match="not an empty folder"):
        write_capture("ball", tmp_path, SMALL)
    assert (tmp_path / "kept.txt").read_text() == "mine"


def test_an_unknown_scene_leaves_nothing_behind(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="glossy, lambert, foliage, ball"):
        write_capture("vase", tmp_path / "a", SMALL)
    assert list(tmp_path.iterdir()) == []


def test_a_failure_half_way_leaves_nothing_behind(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import ibrpipe.synthetic.capture as capture

    def fail(*_: object) -> None:
        raise OSError("no space left on device")

    monkeypatch.setattr(capture, "write_exr", fail)
    with pytest.raises(OSError, match="no space"):
        write_capture("ball", tmp_path / "a", SMALL)
    assert list(tmp_path.iterdir()) == []


def test_an_empty_folder_may_be_filled_and_names_need_not_be_ascii(tmp_path: Path) -> None:
    folder = tmp_path / "Aufnähme é"
    folder.mkdir()
    write_capture("ball", folder, SMALL)
    assert len(read_capture(folder).train) == 4


def test_what_is_withheld_goes_to_truth(tiny_ball, tmp_path):
    bare = write_capture("ball", tmp_path / "bare", TINY.model_copy(update={"cameras": False, "mesh": False}))
    assert sorted(path.name for path in bare.iterdir()) == ["images", "masks", "scene.json", "truth"]
    assert sorted(path.name for path in (bare / "truth").iterdir()) == ["mesh.ply", "sparse", "transforms.json"]
    for name in ("images/003.png", "truth/sparse/0/images.txt", "truth/mesh.ply"):
        assert (bare / name).read_bytes() == (tiny_ball / name.removeprefix("truth/")).read_bytes()
