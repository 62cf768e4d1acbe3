"""The `ldi` renderer against a float64 brute force over all patches, on random sources and hard cases."""

from __future__ import annotations

import ldi_twin
import numpy as np
import pytest

import ibrpipe
from ibrpipe.types import Asset, Camera, DepthImage, LayeredDepthImage, ParallelFrame, ReliefTexture, SpiralTexture

PLAIN = ParallelFrame((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1))
SKEW = ParallelFrame((3, -2, 5), (0.5, 0.1, 0.02), (-0.2, 0.7, 0.1), np.array([0.3, -0.2, 0.9]) / np.sqrt(0.94))


def relief(frame, height):
    rng = np.random.default_rng(1)
    return ReliefTexture(frame, rng.random((*height.shape, 3)), np.asarray(height, np.float32))


def layered(frame, shape, seed, share=0.8, deepest=3, thickness=4.0):
    """Random samples: a smooth sheet with its normals, holes, further sheets of random depth, unknown normals."""
    rng = np.random.default_rng(seed)
    counts, depths, normals = [], [], []
    for r in range(shape[0]):
        for c in range(shape[1]):
            smooth = [2.0 + 0.3 * np.sin(0.7 * c) + 0.2 * r] if rng.random() < share else []
            more = list(rng.random(rng.integers(0, deepest)) * thickness + 1.0)
            here = sorted(smooth + more)
            counts.append(len(here))
            depths += here
            for _ in here:
                n = rng.normal(size=3) * 0.4 - (frame.R[2] if isinstance(frame, Camera) else frame.f)
                normals.append(np.full(3, np.nan) if rng.random() < 0.2 else n / np.linalg.norm(n))
    ends = np.cumsum(counts, dtype=np.int64).reshape(shape)
    offsets = np.concatenate([np.r_[0, ends[:-1, -1]][:, None], ends], 1)
    color = rng.random((len(depths), 3))
    return LayeredDepthImage(frame, offsets, np.array(depths), color, np.array(normals).reshape(-1, 3))


def middle(frame, shape, depth):
    """World point at the middle of the texture."""
    if isinstance(frame, Camera):
        return frame.center + depth * frame.world_from_pixel @ (shape[1] / 2, shape[0] / 2, 1)
    return frame.origin + frame.a * shape[1] / 2 + frame.b * shape[0] / 2 + frame.f * depth


def check(source, camera, flips=0.01, tight=2e-6):
    """All searches' depths lie between the hits of slightly larger and slightly smaller patches, at every pixel."""
    larger, smaller = ldi_twin.cast(source, camera, 1e-6), ldi_twin.cast(source, camera, -1e-6)
    room = tight * np.where(np.isfinite(larger), larger, 0.0)
    same = np.isclose(larger, smaller, rtol=1e-5, atol=0)
    assert np.mean(~same) <= flips
    for search in ("patches", "lines", "quadtree"):
        frame = ibrpipe.render(source, camera, search=search)
        got = frame.depth.astype(float)
        assert not np.isnan(got).any()
        assert (got >= larger - room).all()
        assert (got <= smaller + np.where(np.isfinite(smaller), tight * smaller, 0.0)).all()
        assert (frame.alpha == np.isfinite(frame.depth)).all()
        assert np.isfinite(frame.color).all()
    return frame


@pytest.mark.parametrize("shape", [(9, 13), (16, 16), (2, 2), (2, 17), (33, 5)])
@pytest.mark.parametrize("frame", [PLAIN, SKEW], ids=["plain", "skew"])
@pytest.mark.parametrize("holes", [0.0, 0.15])
def test_relief_equals_brute_force(shape, frame, holes):
    rng = np.random.default_rng(7)
    height = rng.random(shape) * 3
    height[rng.random(shape) < holes] = np.nan
    target = middle(frame, shape, 1.5)
    for way in ((1, 2, 5), (-4, 1, -3), (3, -5, 0.7)):
        check(relief(frame, height), Camera.look_at(target + 2.5 * np.array(way), target, width=44, height=36))


@pytest.mark.parametrize("shape", [(1, 1), (1, 7), (6, 1), (7, 9), (12, 8)])
@pytest.mark.parametrize("frame", [PLAIN, SKEW], ids=["plain", "skew"])
def test_layers_equal_brute_force(shape, frame):
    source = layered(frame, shape, seed=sum(shape))
    target = middle(frame, shape, 2.5)
    for way in ((1, 2, -5), (-4, 1, -3), (3, -5, 0.2)):
        frame_seen = check(source, Camera.look_at(target + 2.5 * np.array(way), target, width=40, height=30))
    assert frame_seen.stats["hits"] >= 0


def test_layers_are_seen_from_the_front_only():
    source = layered(PLAIN, (6, 6), seed=2, share=1.0, deepest=1)
    front = ibrpipe.render(source, Camera.look_at((3, 3.2, -9), (3, 3, 3), width=32, height=32))
    back = ibrpipe.render(source, Camera.look_at((3, 3.2, 15), (3, 3, 3), width=32, height=32))
    assert front.stats["hits"] > 100
    assert back.stats["hits"] == 0


@pytest.mark.parametrize("seed", range(3))
def test_perspective_layers_equal_brute_force(seed):
    camera = Camera.look_at((1, 2, 3), (0.5, -1, 0), width=10, height=8)
    source = layered(camera, (8, 10), seed)
    target = middle(camera, (8, 10), 3.0)
    check(source, camera.resized(43, 31), flips=1.0)
    for shift in ((0.4, 0.1, 0.3), (-0.8, 0.5, 0.0)):
        check(source, Camera.look_at(camera.center + shift, target, width=36, height=30))


def test_depth_image_equals_brute_force_and_its_own_picture():
    camera = Camera.look_at((0, 0, 5), (0, 0, 0), up=(0, 1, 0), width=16, height=12)
    x = np.arange(16) + np.zeros((12, 1))
    depth = (4 + 0.1 * np.sin(x) + np.where(x > 8, 2.0, 0.0)).astype(np.float32)
    depth[3:5, 2:4] = np.inf
    rng = np.random.default_rng(0)
    source = DepthImage(camera, rng.random((12, 16, 3)), depth)
    own = ibrpipe.render(source, camera)
    np.testing.assert_allclose(own.depth, depth, rtol=1e-5)
    there = np.isfinite(depth)
    np.testing.assert_allclose(own.color[there], source.color[there], atol=1e-4)
    check(source, Camera.look_at((0.5, 0.3, 5.2), (0, 0, 0), up=(0, 1, 0), width=40, height=30))


def hard_height(kind):
    height = np.full((12, 15), 1.0)
    if kind == "spike":
        height[5, 6], height[8, 3] = 9.0, -6.0
    if kind == "step":
        height[:, 8:] = 4.0
    return height


@pytest.mark.parametrize("kind", ["constant", "spike", "step"])
@pytest.mark.parametrize(
    ("eye", "target"),
    [
        ((7.5, 6.0, 0.0), (7.5, 8.0, 1.0)),  # in the frame's plane
        ((7.5, 6.0, 1.0), (12.0, 9.0, 1.0)),  # at the height of the texels
        ((7.5, 6.5, 2.5), (3.0, 2.0, 1.0)),  # inside the volume
        ((5.5, 5.5, 1.0), (9.0, 9.0, 0.7)),  # on a texel
        ((-30.0, 6.0, 1.02), (0.0, 6.0, 1.0)),  # grazing
    ],
)
def test_hard_eyes(kind, eye, target):
    camera = Camera.look_at(eye, target, fov_y_deg=50, width=33, height=27)
    source = relief(PLAIN, hard_height(kind))
    larger, smaller = ldi_twin.cast(source, camera, 1e-6), ldi_twin.cast(source, camera, -1e-6)
    clear = np.isfinite(larger) & np.isclose(larger, smaller, rtol=1e-6, atol=0) & (larger > 1e-3)
    for search in ("patches", "lines", "quadtree"):
        frame = ibrpipe.render(source, camera, search=search)
        assert not np.isnan(frame.depth).any()
        error = np.abs(frame.depth[clear] - larger[clear]) / larger[clear]
        assert (error > 1e-4).sum() <= 1
        lost = ~np.isfinite(larger) & np.isfinite(frame.depth)
        assert lost.sum() == 0


@pytest.mark.parametrize("offset", [0.0, 0.25, 0.5])
def test_axis_parallel_rays_and_rays_through_corners(offset):
    camera = Camera([[1e6, 0, 8], [0, 1e6, 8], [0, 0, 1]], np.c_[np.eye(3), [-10 - offset, -10 - offset, 1e6]], 16, 16)
    rng = np.random.default_rng(3)
    source = relief(PLAIN, rng.random((20, 20)) * 2)
    frame = ibrpipe.render(source, camera)
    wanted = ldi_twin.cast(source, camera, 1e-7)
    assert np.isfinite(frame.depth).all()
    np.testing.assert_allclose(frame.depth, wanted, rtol=1e-6)


@pytest.mark.parametrize("width", [1e-6, 1.0, 1e6])
def test_far_from_the_origin_and_tiny(width):
    far = np.array([1e6, -1e6, 1e6]) if width == 1.0 else np.zeros(3)
    scale = width / 16
    frame = ParallelFrame(far, (scale, 0, 0), (0, scale, 0), (0, 0, 1))
    rng = np.random.default_rng(4)
    source = relief(frame, rng.random((16, 16)) * 2 * scale)
    target = far + scale * np.array([8, 8, 1])
    camera = Camera.look_at(target + scale * np.array([5, 9, 20]), target, width=40, height=30)
    seen = check(source, camera, flips=0.02, tight=1e-5)
    assert seen.stats["hits"] > 200


def test_several_sources_are_composited_by_depth():
    rng = np.random.default_rng(5)
    low, high = relief(PLAIN, rng.random((12, 12))), relief(PLAIN, rng.random((12, 12)) + 0.4)
    camera = Camera.look_at((6, -9, 12), (6, 6, 0.5), width=50, height=40)
    both = ibrpipe.render([low, high], camera)
    apart = [ibrpipe.render(part, camera) for part in (low, high)]
    np.testing.assert_array_equal(both.depth, np.minimum(apart[0].depth, apart[1].depth))
    first = apart[0].depth < apart[1].depth
    np.testing.assert_array_equal(both.color[first], apart[0].color[first])


def test_assets_and_empty_layers():
    layers = layered(PLAIN, (6, 7), seed=9)
    camera = Camera.look_at((3, 3, -9), (3, 3, 2), width=24, height=20)
    asset = ibrpipe.render(Asset((SpiralTexture(layers),)), camera)
    np.testing.assert_array_equal(asset.depth, ibrpipe.render(layers, camera).depth)
    none = LayeredDepthImage(PLAIN, np.zeros((3, 4), np.int64), np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3)))
    nothing = ibrpipe.render(none, camera)
    assert nothing.stats["hits"] == 0
    assert (nothing.color == 0).all()
    holes = relief(PLAIN, np.full((4, 4), np.nan))
    assert ibrpipe.render(holes, camera).stats["hits"] == 0


def test_thread_count_changes_no_byte():
    rng = np.random.default_rng(6)
    source = ibrpipe.prepare([relief(SKEW, rng.random((40, 50)) * 3), layered(PLAIN, (9, 9), 3)])
    camera = Camera.look_at((12, -8, 25), (10, 10, 3), width=101, height=67)
    one, two = (ibrpipe.render(source, camera, threads=count) for count in (1, 2))
    assert one.depth.tobytes() == two.depth.tobytes()
    assert one.color.tobytes() == two.color.tobytes()


def test_only_what_is_asked_for_is_there():
    camera = Camera.look_at((6, -9, 12), (6, 6, 0.5), width=20, height=16)
    source = relief(PLAIN, np.random.default_rng(0).random((12, 12)))
    frame = ibrpipe.render(source, camera, outputs="depth")
    assert frame.color is None
    assert frame.alpha is None
    np.testing.assert_array_equal(frame.depth, ibrpipe.render(source, camera).depth)


def test_colour_is_bilinear_between_texel_centres():
    y, x = np.mgrid[:10, :12] + 0.5
    color = np.stack([x / 12, y / 10, np.full_like(x, 0.25)], -1)
    source = ReliefTexture(PLAIN, color, np.zeros((10, 12)))
    camera = Camera.look_at((6, 4, 9), (6, 5, 0), width=30, height=30)
    frame = ibrpipe.render(source, camera)
    v, u = np.nonzero(np.isfinite(frame.depth))
    point = camera.center + frame.depth[v, u, None] * (
        np.stack([u + 0.5, v + 0.5, np.ones_like(u)], -1) @ camera.world_from_pixel.T
    )
    np.testing.assert_allclose(frame.color[v, u, 0], point[:, 0] / 12, atol=1e-5)
    np.testing.assert_allclose(frame.color[v, u, 1], point[:, 1] / 10, atol=1e-5)
