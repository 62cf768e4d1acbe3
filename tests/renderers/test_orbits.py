"""Cameras around any asset, its box, and frames as files."""

from __future__ import annotations

import numpy as np
import pytest

import ibrpipe
from ibrpipe.errors import ConfigError, FormatError, ShapeError, ValueRangeError
from ibrpipe.io.photos.images import read_depth, read_image

FRAME = ibrpipe.ParallelFrame((10, 20, 30), (0.1, 0, 0), (0, 0.1, 0), (0, 0, 1))


def flat_asset(info: dict | None = None) -> ibrpipe.Asset:
    """A square of 30 x 40 texels, 3 x 4 scene units, far from the origin."""
    offsets = np.tile(np.arange(31, dtype=np.int64), (40, 1)) + 30 * np.arange(40)[:, None]
    color = np.full((1200, 3), 0.5, np.float32)
    normal = np.tile(np.float32([0, 0, -1]), (1200, 1))
    layers = ibrpipe.LayeredDepthImage(FRAME, offsets, np.zeros(1200, np.float32), color, normal)
    return ibrpipe.Asset((ibrpipe.Texture(layers),), info or {})


def test_bounds_are_those_of_the_samples():
    low, high = flat_asset().bounds
    np.testing.assert_allclose(low, [10.05, 20.05, 30])
    np.testing.assert_allclose(high, [12.95, 23.95, 30])
    with pytest.raises(ValueRangeError, match="no sample"):
        _ = flat_asset({"textures": [{"name": "background 1"}]}).bounds
    with pytest.raises(ValueRangeError, match="no sample"):
        _ = ibrpipe.Asset(()).bounds


def test_every_camera_of_an_orbit_shows_all_of_any_asset():
    asset = flat_asset()
    corners = np.stack(np.meshgrid(*zip(*asset.bounds)), axis=-1).reshape(-1, 3)
    cameras = ibrpipe.orbit(asset, 5, elevation=30, width=64, height=48)
    assert len(cameras) == 5
    for camera in cameras:
        local = corners @ camera.R.T + camera.cam_from_world[:, 3]
        pixels = local @ camera.K.T
        pixels = pixels[:, :2] / pixels[:, 2:]
        assert (local[:, 2] > 0).all()
        assert (pixels > 0).all()
        assert (pixels < [64, 48]).all()
    with pytest.raises(ConfigError, match='"elevation"'):
        ibrpipe.orbit(asset, 5, elevaton=30)


def test_frames_are_saved_and_shown(tmp_path):
    asset = flat_asset()
    camera = ibrpipe.orbit(asset, 1, elevation=-60, width=40, height=30)[0]
    frame = ibrpipe.render(asset, camera)
    frame.save(tmp_path / "a.png")
    frame.save(str(tmp_path / "a.exr"))
    np.testing.assert_array_equal(read_depth(tmp_path / "a.exr"), frame.depth)
    picture = read_image(tmp_path / "a.png")
    assert picture.shape == (30, 40, 4)
    inside = frame.alpha == 1
    assert inside.sum() > 100
    np.testing.assert_allclose(picture[inside][:, :3], frame.color[inside], atol=0.005)
    assert frame._repr_png_() == (tmp_path / "a.png").read_bytes()
    with pytest.raises(FormatError, match=r"\.png or \.exr"):
        frame.save(tmp_path / "a.gif")
    depth = ibrpipe.render(asset, camera, outputs=("depth",))
    assert depth._repr_png_() is None
    with pytest.raises(ShapeError, match="no colour"):
        depth.save(tmp_path / "b.png")
