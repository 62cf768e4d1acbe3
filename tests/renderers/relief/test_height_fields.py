"""The `relief` renderer on textures: exact search against a float64 brute force, published search against a twin."""

from __future__ import annotations

import ldi_twin
import numpy as np
import pytest
import relief_twin

import ibrpipe
from ibrpipe.renderers.relief import height_fields
from ibrpipe.types import Asset, Camera, LayeredDepthImage, ParallelFrame, ReliefTexture, SpiralTexture

PLAIN = ParallelFrame((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1))
SKEW = ParallelFrame((3, -2, 5), (0.5, 0.1, 0.02), (-0.2, 0.7, 0.1), np.array([0.3, -0.2, 0.9]) / np.sqrt(0.94))


def relief(frame, height):
    rng = np.random.default_rng(1)
    return ReliefTexture(frame, rng.random((*height.shape, 3)), np.asarray(height, np.float32))


def rough(shape, holes=0.0, seed=7):
    rng = np.random.default_rng(seed)
    height = rng.random(shape) * 3
    height[rng.random(shape) < holes] = np.nan
    return height


def middle(frame, shape, depth):
    return frame.origin + frame.a * shape[1] / 2 + frame.b * shape[0] / 2 + frame.f * depth


def check(source, camera, flips=0.01, tight=2e-6, slack=3e-5, lost=0):
    """Depths lie between the hits of slightly larger and slightly smaller patches, at every pixel but `lost`."""
    larger, smaller = ldi_twin.cast(source, camera, slack), ldi_twin.cast(source, camera, -slack)
    room = np.where(np.isfinite(larger), tight * larger, 0.0)
    assert np.mean(~np.isclose(larger, smaller, rtol=1e-5, atol=0)) <= flips
    frame = ibrpipe.render(source, camera, renderer="relief")
    got = frame.depth.astype(float)
    assert not np.isnan(got).any()
    good = (got >= larger - room) & (got <= smaller + np.where(np.isfinite(smaller), tight * smaller, 0.0))
    assert (~good).sum() <= lost
    assert (frame.alpha == np.isfinite(frame.depth)).all()
    assert np.isfinite(frame.color).all()
    return frame


@pytest.mark.parametrize("shape", [(9, 13), (16, 16), (2, 2), (2, 17), (33, 5)])
@pytest.mark.parametrize("frame", [PLAIN, SKEW], ids=["plain", "skew"])
@pytest.mark.parametrize("holes", [0.0, 0.15])
def test_exact_search_equals_brute_force(shape, frame, holes):
    target = middle(frame, shape, 1.5)
    for way in ((1, 2, 5), (-4, 1, -3), (3, -5, 0.7)):
        camera = Camera.look_at(target + 2.5 * np.array(way), target, width=44, height=36)
        check(relief(frame, rough(shape, holes)), camera)


@pytest.mark.parametrize("frame", [PLAIN, SKEW], ids=["plain", "skew"])
def test_large_fields_are_searched_along_lines_and_equal_brute_force(frame, monkeypatch):
    target, shape = middle(frame, (33, 25), 1.5), (33, 25)
    source = relief(frame, rough(shape, 0.1))
    for way in ((1, 2, 5), (-4, 1, -3), (3, -5, 0.7)):
        camera = Camera.look_at(target + 2.5 * np.array(way), target, width=44, height=36)
        marched = ibrpipe.render(source, camera, "relief")
        with monkeypatch.context() as patch:
            patch.setattr(height_fields, "LINES", 0)
            assert ibrpipe.prepare(source, "relief").data.parts[0].lines is not None
            frame_of_lines = check(source, camera)
        same = np.isclose(frame_of_lines.depth, marched.depth, rtol=1e-5)
        assert same.mean() > 0.99
        np.testing.assert_allclose(frame_of_lines.color[same], marched.color[same], atol=2e-3)


@pytest.mark.parametrize("shape", [(1, 1), (1, 7), (6, 1)])
def test_thin_textures_equal_brute_force(shape):
    height = rough(shape)
    height[..., : shape[1] // 3] = np.nan
    if shape == (1, 1):
        height[:] = 1.0
    target = middle(PLAIN, shape, 1.5)
    for way in ((1, 2, -5), (-4, 1, -3)):
        source = relief(PLAIN, height)
        frame = check(source, Camera.look_at(target + 2.5 * np.array(way), target, width=40, height=30))
        same = ibrpipe.render(source, Camera.look_at(target + 2.5 * np.array(way), target, width=40, height=30))
        both = np.isfinite(frame.depth) & np.isfinite(same.depth)
        assert both.any()
        np.testing.assert_allclose(frame.color[both], same.color[both], atol=2e-4)


def hard_height(kind):
    height = np.full((12, 15), 1.0)
    if kind == "spike":
        height[5, 7] = 9.0
    elif kind == "pit":
        height[5, 7] = -9.0
    elif kind == "step":
        height[:, 8:] = 3.0
    elif kind == "island":
        height[:] = np.nan
        height[4:6, 4:6] = 2.0
    elif kind == "empty":
        height[:] = np.nan
    return height


@pytest.mark.parametrize("kind", ["constant", "spike", "pit", "step", "island", "empty"])
@pytest.mark.parametrize(
    "eye", [(7.5, 6, 12), (-9, 5, 1.0), (30, 7.2, 1.2), (7.5, 5.5, 1.0), (7.5, 5.5, 4.0), (3, 3, -5)]
)
def test_hard_heights_equal_brute_force(kind, eye):
    """Eyes above, in the plane of a constant field, grazing, on the surface, inside the volume, below."""
    target = (7.4, 6.1, 1.0) if eye[2] != 1.0 else (7.4, 6.1, 0.9)
    camera = Camera.look_at(eye, target, up=(0, 1, 0), fov_y_deg=70, width=40, height=30)
    source = relief(PLAIN, hard_height(kind))
    if eye != (7.5, 5.5, 1.0):
        check(source, camera)
        return
    larger, smaller = ldi_twin.cast(source, camera, 3e-5), ldi_twin.cast(source, camera, -3e-5)
    clear = np.isclose(larger, smaller, rtol=1e-6, atol=0) & (larger > 1e-3)  # the eye itself is no hit
    seen = ibrpipe.render(source, camera, renderer="relief").depth
    assert not np.isnan(seen).any()
    np.testing.assert_allclose(seen[clear], larger[clear], rtol=1e-5)
    assert not np.isfinite(seen[np.isinf(larger)]).any()


def test_rays_along_an_axis_and_through_texel_corners():
    height = rough((16, 16))
    K = [[16, 0, 8.0], [0, 16, 8.0], [0, 0, 1]]
    for shift in (0.0, 0.5):
        for R in (np.diag([1.0, -1.0, -1.0]), np.array([[0.0, 1, 0], [0, 0, -1], [-1, 0, 0]])):
            eye = np.array([8.0 + shift, 8.0 + shift, 17.0]) if R[2, 2] else np.array([40.0, 8.0 + shift, 1.0])
            camera = Camera(K, np.concatenate([R, (-R @ eye)[:, None]], 1), 17, 17)
            check(relief(PLAIN, height), camera, flips=0.1)


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
@pytest.mark.parametrize("away", [0.0, 1e6])
def test_far_and_tiny_scenes(scale, away):
    move = np.array([away, -away, away])
    frame = ParallelFrame(move, (scale, 0, 0), (0, scale, 0), (0, 0, 1))
    target = move + scale * np.array([6, 6, 1.5])
    camera = Camera.look_at(target + scale * np.array([3, -4, 15.0]), target, width=32, height=24)
    height = rough((12, 12)) * scale
    tight = 2e-6 if scale >= 1.0 or away == 0 else 1e-3  # poses themselves are rounded there
    check(relief(frame, height), camera, flips=0.05, tight=tight)


def test_published_search_equals_its_twin():
    source = relief(SKEW, rough((20, 14)))
    target = middle(SKEW, (20, 14), 1.5)
    for way in ((1, 2, 5), (-4, 1, 3), (3, -5, 1.2)):
        camera = Camera.look_at(target + 3.0 * np.array(way), target, width=40, height=30)
        for steps, halvings in ((32, 8), (7, 3), (1, 0)):
            wanted = relief_twin.linear_binary(source, camera, steps, halvings)
            frame = ibrpipe.render(
                source, camera, renderer="relief", search="linear-binary", linear_steps=steps, binary_steps=halvings
            )
            same = np.isclose(frame.depth, wanted, rtol=1e-5)
            assert np.isfinite(wanted).mean() > 0.1
            assert (~same).mean() <= 0.004  # a sample within a rounding of the surface falls on its other side


def test_published_search_misses_what_the_exact_one_finds():
    height = np.zeros((64, 64))
    height[32, 32], height[0, 0] = 8.0, -0.5
    camera = Camera.look_at((32.5, -40, 20), (32.5, 32.5, 4), width=96, height=72, fov_y_deg=30)
    exact = ibrpipe.render(relief(PLAIN, height), camera, renderer="relief")
    steps = ibrpipe.render(relief(PLAIN, height), camera, renderer="relief", search="linear-binary", linear_steps=8)
    off = ~np.isclose(exact.depth, steps.depth, atol=1.0)
    assert 20 < off.sum() < 400


def layers_of(height, depth_behind):
    """A layered image: `height` in front, a second sample behind it; no sample where the height is NaN."""
    there = np.isfinite(height)
    counts = np.where(there, 2, 0)
    ends = np.cumsum(counts).reshape(height.shape)
    offsets = np.concatenate([np.r_[0, ends[:-1, -1]][:, None], ends], 1)
    front = height[there]
    depth = np.stack([front, front + depth_behind], 1).ravel()
    color = np.tile([[0.2, 0.4, 0.6], [1, 0, 0]], (len(front), 1))
    return LayeredDepthImage(PLAIN, offsets, depth, color, np.full((len(depth), 3), np.nan))


def test_first_layer_of_layered_images_and_assets():
    layers = layers_of(rough((9, 11)), 5.0)
    front = Camera.look_at((5, 4.2, -14), (5.4, 4.4, 1), up=(0, 1, 0), width=48, height=40)
    relief_seen = ibrpipe.render(relief(PLAIN, rough((9, 11))), front, renderer="relief")
    for source in (layers, SpiralTexture(layers), Asset((SpiralTexture(layers),))):
        seen = ibrpipe.render(source, front, renderer="relief")
        np.testing.assert_array_equal(seen.depth, relief_seen.depth)
        np.testing.assert_allclose(seen.color[seen.alpha > 0], [[0.2, 0.4, 0.6]] * int(seen.stats["hits"]), atol=1e-6)
    behind = Camera.look_at((5, 4.2, 30), (5.4, 4.4, 1), up=(0, 1, 0), width=48, height=40)
    assert ibrpipe.render(layers, behind, renderer="relief").stats["hits"] == 0


def test_steps_of_over_four_texels_are_not_joined():
    height = np.zeros((8, 12))
    height[:, 6:] = 9.0
    front = Camera.look_at((6, 4, -30), (6, 4, 0), up=(0, 1, 0), width=60, height=40)
    seen = ibrpipe.render(layers_of(height, 1.0), front, renderer="relief").depth
    hit = seen[np.isfinite(seen)]
    assert ((abs(hit - 30) < 0.1) | (abs(hit - 39) < 0.1)).all()


def test_nearest_of_several_sources_wins():
    near, far = relief(PLAIN, np.full((8, 8), 2.0)), relief(PLAIN, np.full((8, 8), 1.0))
    camera = Camera.look_at((4, 4.1, 9), (4, 4, 0), up=(0, 1, 0), width=24, height=20)
    for order in ([near, far], [far, near]):
        seen = ibrpipe.render(order, camera, renderer="relief")
        np.testing.assert_array_equal(seen.depth, ibrpipe.render(near, camera, renderer="relief").depth)


def test_thread_count_changes_no_byte():
    source = relief(SKEW, rough((40, 30), 0.1))
    eye = middle(SKEW, (40, 30), 9.0) + np.array([5, 2, 8])
    camera = Camera.look_at(eye, middle(SKEW, (40, 30), 1.5), width=70, height=50)
    for search in ("exact", "linear-binary"):
        one, two = (ibrpipe.render(source, camera, renderer="relief", search=search, threads=n) for n in (1, 0))
        assert one.depth.tobytes() == two.depth.tobytes()
        assert one.color.tobytes() == two.color.tobytes()


def test_wrong_options_are_told():
    camera = Camera.look_at((4, 4, 9), (4, 4.1, 0))
    source = relief(PLAIN, np.zeros((4, 4)))
    with pytest.raises(ibrpipe.IbrError, match="search is 'best'"):
        ibrpipe.render(source, camera, renderer="relief", search="best")
    with pytest.raises(ibrpipe.IbrError, match="linear_steps is 0"):
        ibrpipe.render(source, camera, renderer="relief", linear_steps=0)
    perspective = LayeredDepthImage(
        camera.resized(2, 2),
        np.arange(3)[None] * 1 + np.array([[0], [2]]),
        np.ones(4),
        np.ones((4, 3)),
        np.ones((4, 3)),
    )
    with pytest.raises(ibrpipe.IbrError, match="perspective"):
        ibrpipe.render(perspective, camera, renderer="relief")
