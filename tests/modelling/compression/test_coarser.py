"""Coarser texels: what is flat stays exactly, two surfaces stay two, outlines stay where they are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ibrpipe.io.assets import read_asset, read_index, write_asset
from ibrpipe.modelling.compression.coarser import coarser, joined, write_coarser
from ibrpipe.modelling.compression.parts import Source
from ibrpipe.types import Asset, Camera, LayeredDepthImage, ParallelFrame, ReflectedLight, Reflection, Texture
from ibrpipe.types.layers import offsets_of

FRAME = ParallelFrame((1, 2, 3), (0.1, 0, 0), (0, 0.1, 0), (0, 0, 1))


def plane(height: int = 13, width: int = 18, slope: float = 0.3, frame=FRAME) -> LayeredDepthImage:
    """A slanted plane whose colour is its place."""
    v, u = np.mgrid[:height, :width]
    depth = (2 + 0.1 * slope * (u + 0.5)).ravel()
    color = np.stack([u / width, v / height, np.full(u.shape, 0.5)], axis=2).reshape(-1, 3)
    normal = np.tile(np.array([0.3, 0, -1]) / np.hypot(0.3, 1), (height * width, 1))
    return LayeredDepthImage(
        frame, offsets_of(np.ones((height, width), int)), depth, color, normal, np.arange(height * width) % 7
    )


@pytest.mark.parametrize("factor", [2, 3])
def test_a_plane_stays_the_plane(factor: int) -> None:
    fine, (coarse, group, count) = plane(), joined(plane(), factor)
    assert coarse.shape == (-(-13 // factor), -(-18 // factor))
    assert count == len(coarse.depth) == coarse.shape[0] * coarse.shape[1]
    assert (group >= 0).all()
    u = np.arange(coarse.shape[1]) + 0.5
    whole = coarse.depth.reshape(coarse.shape)[:, : 18 // factor]
    np.testing.assert_allclose(
        whole, np.broadcast_to(2 + 0.1 * factor * 0.3 * u, coarse.shape)[:, : 18 // factor], rtol=1e-6
    )
    np.testing.assert_allclose(coarse.normal, np.broadcast_to(fine.normal[0], coarse.normal.shape), atol=1e-6)
    block = fine.color.reshape(13, 18, 3)[:factor, :factor].mean(axis=(0, 1))
    np.testing.assert_allclose(coarse.color[0], block, rtol=1e-6)
    assert coarse.observers[0] == fine.observers.reshape(13, 18)[:factor, :factor].max()


def test_two_sheets_stay_two_and_what_few_texels_hold_goes() -> None:
    counts = np.full((4, 4), 2)
    counts[0, 0], counts[2:, 2:] = 3, 0
    counts[3, 3] = 1
    depth = np.concatenate([(1.0, 5.0, 9.0)[:n] for n in counts.ravel()])
    layers = LayeredDepthImage(
        FRAME, offsets_of(counts), depth, np.ones((len(depth), 3)), np.tile((0, 0, -1.0), (len(depth), 1))
    )
    coarse, group, count = joined(layers, 2)
    np.testing.assert_array_equal(np.diff(coarse.offsets, axis=1), [[2, 2], [2, 0]])
    np.testing.assert_allclose(coarse.depth, [1, 5] * 3)
    assert count == 6
    assert (group == -1).sum() == 2
    assert coarse.observers is None


def test_a_perspective_frame_looks_the_same_way() -> None:
    camera = Camera.look_at((0, 0, -4), (0, 0, 0), width=18, height=13)
    coarse, _, _ = joined(replace(plane(slope=0.0), frame=camera), 2)
    ray = camera.pixel_rays()[:2, :2].mean(axis=(0, 1))
    np.testing.assert_allclose(coarse.frame.pixel_rays()[0, 0], ray, rtol=1e-6)


def test_weights_go_along() -> None:
    fine = plane(4, 4)
    weights = np.random.default_rng(0).random((16, 2)).astype(np.float32)
    light = ReflectedLight(np.ones((2, 4, 4, 3)), (0.04, 0.9))
    (texture,) = coarser(Asset((Texture(fine, (Reflection(light, weights),)),)), 2).textures
    wanted = weights.reshape(2, 2, 2, 2, 2).mean(axis=(1, 3)).reshape(4, 2)
    np.testing.assert_allclose(texture.component("reflection").weights, wanted, rtol=1e-6)


def test_coverage_goes_along() -> None:
    share = (0.25 + 0.5 * np.random.default_rng(2).random(16)).astype(np.float32)
    coarse, _, _ = joined(replace(plane(4, 4), coverage=share), 2)
    np.testing.assert_allclose(coarse.coverage, share.reshape(2, 2, 2, 2).mean(axis=(1, 3)).ravel(), rtol=1e-6)
    assert joined(plane(4, 4), 2)[0].coverage is None


def test_what_is_shared_keeps_its_file(tmp_path) -> None:
    light = ReflectedLight(np.random.default_rng(1).random((1, 16, 16, 3)), (0.04,))
    asset = Asset((Texture(plane(), (Reflection(light, None),)),))
    write_asset(asset, tmp_path / "fine", quality=60)
    fine = Source(tmp_path / "fine", read_index(tmp_path / "fine"), read_asset(tmp_path / "fine"))
    coarse = write_coarser(fine, 2, tmp_path / "coarse")
    assert coarse.asset.textures[0].layers.shape == (7, 9)
    name = "reflection_0.webp"
    assert (tmp_path / "coarse" / name).read_bytes() == (tmp_path / "fine" / name).read_bytes()
    np.testing.assert_array_equal(coarse.asset.shared["reflection"].tables, fine.asset.shared["reflection"].tables)


def test_nothing_stays_nothing() -> None:
    empty = LayeredDepthImage(FRAME, offsets_of(np.zeros((3, 3), int)), np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3)))
    coarse, _, count = joined(empty, 2)
    assert (coarse.shape, count) == ((2, 2), 0)
