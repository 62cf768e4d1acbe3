"""Placing depth images over a mesh, their file, and their asset."""

from __future__ import annotations

import json

import numpy as np
import pytest
import yaml
from click.testing import CliRunner

import ibrpipe
from ibrpipe.bench.sizes.table2 import globe, torus
from ibrpipe.cli.main import cli
from ibrpipe.embree import MeshCaster
from ibrpipe.errors import ConfigError
from ibrpipe.io.surfaces.meshes import write_mesh
from ibrpipe.modelling.depth_images import depth_images_asset
from ibrpipe.modelling.frusta import (
    Frustum,
    central_frusta,
    covered_share,
    cube_frusta,
    entries_from_frusta,
    frusta_from_entries,
    greedy_frusta,
)
from ibrpipe.types import Camera


def test_six_depth_images_cover_a_globe():
    mesh = globe(24)
    asset = depth_images_asset(mesh, cube_frusta(mesh), 96, "globe")
    for eye in ((3, 2, 1), (-2, 1, -3)):
        camera = Camera.look_at(eye, (0, 0, 0), width=80, height=60)
        truth = MeshCaster(mesh).cast_camera(camera).t
        for renderer, options in (("epipolar", {}), ("ldi", {}), ("epipolar", {"search": "linear"})):
            seen = ibrpipe.render(asset, camera, renderer, **options).depth
            hit, got = np.isfinite(truth), np.isfinite(seen)
            assert (got & hit).sum() > 0.97 * hit.sum()
            assert np.median(np.abs(seen[got & hit] - truth[got & hit])) < 0.01


def test_a_globe_displaced_from_its_centre_is_seen_from_outside():
    mesh = globe(24)
    asset = depth_images_asset(mesh, central_frusta(mesh), 96, "globe")
    assert len(asset.textures) == 6
    camera = Camera.look_at((3, 2, 1), (0, 0, 0), width=80, height=60)
    truth = MeshCaster(mesh).cast_camera(camera).t
    for renderer, options in (("epipolar", {}), ("ldi", {}), ("epipolar", {"search": "nearest"})):
        seen = ibrpipe.render(asset, camera, renderer, **options).depth
        both = np.isfinite(truth) & np.isfinite(seen)
        assert both.sum() > 0.97 * np.isfinite(truth).sum()
        assert np.quantile(np.abs(seen[both] - truth[both]), 0.95) < 0.1
        assert np.median(np.abs(seen[both] - truth[both])) < 0.02


def test_the_command_places_images_in_the_middle(tmp_path):
    write_mesh(globe(12), tmp_path / "globe.ply")
    words = ["depth-images", str(tmp_path / "globe.ply"), "--arrange", "center", "--size", "24", "--json"]
    done = CliRunner().invoke(cli, [*words, "--out", str(tmp_path / "a")], catch_exceptions=False)
    assert done.exit_code == 0
    assert json.loads(done.stdout)["covered"] > 0.9
    asset = ibrpipe.read_asset(tmp_path / "a")
    np.testing.assert_allclose(asset.textures[0].layers.frame.center, 0.0, atol=0.1)
    assert len(asset.textures[0].layers.depth) > 0.95 * 24 * 24


def test_epipolar_and_ldi_see_the_same_asset():
    mesh = torus(24)
    asset = depth_images_asset(mesh, cube_frusta(mesh), 64, "torus")
    camera = Camera.look_at((2.5, -2, 1.6), (0, 0, 0), width=90, height=70)
    one, other = (ibrpipe.render(asset, camera, name) for name in ("epipolar", "ldi"))
    same = np.isclose(one.depth, other.depth, rtol=1e-5) | (np.isinf(one.depth) & np.isinf(other.depth))
    assert one.stats["hits"] > 500
    assert np.mean(~same) < 0.001


def test_greedy_cover_grows_with_the_number_of_images():
    mesh = torus(24)
    two, share_two = greedy_frusta(mesh, 2)
    six, share_six = greedy_frusta(mesh, 6)
    assert (len(two), len(six)) == (2, 6)
    assert six[:2] == two
    assert 0.4 < share_two < share_six
    assert 0.9 < share_six <= 1.0
    assert greedy_frusta(mesh, 6)[0] == six


def test_coverage_of_any_frusta():
    mesh = torus(24)
    frusta, share = greedy_frusta(mesh, 4)
    assert covered_share(mesh, frusta) == share
    assert covered_share(mesh, frusta[:1]) < covered_share(mesh, frusta[:2]) < share
    away = Frustum(eye=(9, 9, 9), target=(20, 20, 20))
    assert covered_share(mesh, [away]) == 0.0


def test_the_command_writes_an_asset_and_frusta_that_can_be_edited(tmp_path):
    write_mesh(torus(12), tmp_path / "torus.ply")
    words = ["depth-images", str(tmp_path / "torus.ply"), "--size", "24", "--maps", "3", "--out", str(tmp_path / "a")]
    done = CliRunner().invoke(cli, words, catch_exceptions=False)
    assert done.exit_code == 0
    assert "3 depth images of 24 x 24" in done.output
    entries = yaml.safe_load((tmp_path / "a/frusta.yaml").read_text())
    assert len(ibrpipe.read_asset(tmp_path / "a").textures) == len(entries) == 3
    edited = tmp_path / "edited.yaml"
    edited.write_text(yaml.safe_dump([{**entries[0], "fov": 30.0}]))
    words = ["depth-images", words[1], "--size", "24", "--frusta", str(edited), "--out", str(tmp_path / "b")]
    told = CliRunner().invoke(cli, [*words, "--json"], catch_exceptions=False)
    assert told.exit_code == 0
    assert json.loads(told.output)["maps"] == 1
    assert 0.05 < json.loads(told.output)["covered"] < 0.6
    frame = ibrpipe.read_asset(tmp_path / "b").textures[0].layers.frame
    np.testing.assert_allclose(2 * np.degrees(np.arctan(12 / frame.K[0, 0])), 30.0)
    missing = CliRunner().invoke(cli, [*words[:-3], str(tmp_path / "none.yaml"), "--out", str(tmp_path / "c")])
    assert missing.exit_code == 1


@pytest.mark.parametrize("entries", [None, 3, [], [{"eye": [0, 0, 1]}], ["x"], [{"eye": 1, "target": 2}]])
def test_broken_files_of_frusta(entries):
    with pytest.raises(ConfigError, match="frusta"):
        frusta_from_entries(entries)


def test_frusta_survive_their_file():
    frusta = cube_frusta(torus(8))
    assert frusta_from_entries(yaml.safe_load(yaml.safe_dump(entries_from_frusta(frusta)))) == frusta
    with pytest.raises(ConfigError, match="zoom"):
        frusta_from_entries([{**entries_from_frusta(frusta)[0], "zoom": 2}])


def test_photos_with_depth_maps_become_an_asset_as_they_are(make_tiny, tmp_path):
    out = tmp_path / "asset"
    done = CliRunner().invoke(cli, ["depth-images", str(make_tiny("ball")), "--out", str(out)], catch_exceptions=False)
    assert done.exit_code == 0, done.output
    asset = ibrpipe.read_asset(out)
    assert f"{len(asset.textures)} depth images of the photos" in done.output
    camera = asset.textures[0].layers.frame
    for renderer in ("epipolar", "ldi"):
        shown = ibrpipe.render(asset, camera, renderer)
        assert np.isfinite(shown.depth).mean() > 0.05
        own = np.full(camera.height * camera.width, np.inf)
        own[np.flatnonzero(np.diff(asset.textures[0].layers.offsets, axis=1))] = asset.textures[0].layers.depth
        both = np.isfinite(own) & np.isfinite(shown.depth.ravel())
        assert both.sum() > 0.9 * np.isfinite(own).sum()
        assert np.median(np.abs(shown.depth.ravel()[both] / own[both] - 1)) < 1e-3
    (tmp_path / "empty").mkdir()
    assert CliRunner().invoke(cli, ["depth-images", str(tmp_path / "empty"), "--out", str(out)]).exit_code == 1
