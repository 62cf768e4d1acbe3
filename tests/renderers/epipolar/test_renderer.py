"""The `epipolar` renderer's exact search against a float64 brute force over all patches, in every epipole region."""

from __future__ import annotations

import ldi_twin
import numpy as np
import pytest
from kernel_runs import on_all_thread_counts

import ibrpipe
from ibrpipe.core.epipolar import lines
from ibrpipe.renderers.search import epipolar_lines as epipolar_maps
from ibrpipe.types import Camera, DepthImage, LayeredDepthImage, ParallelFrame, ReliefTexture

PLAIN = ParallelFrame((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1))
SKEW = ParallelFrame((3, -2, 5), (0.5, 0.1, 0.02), (-0.2, 0.7, 0.1), np.array([0.3, -0.2, 0.9]) / np.sqrt(0.94))


def relief(frame, height):
    rng = np.random.default_rng(1)
    return ReliefTexture(frame, rng.random((*height.shape, 3)), np.asarray(height, np.float32))


def check(source, camera, flips=0.02, tight=2e-6):
    """Depths lie between the hits of slightly larger and slightly smaller patches, at every pixel."""
    larger, smaller = ldi_twin.cast(source, camera, 1e-6), ldi_twin.cast(source, camera, -1e-6)
    room = tight * np.where(np.isfinite(larger), larger, 0.0)
    same = np.isclose(larger, smaller, rtol=1e-5, atol=0)
    assert np.mean(~same) <= flips
    frame = ibrpipe.render(source, camera, "epipolar")
    got = frame.depth.astype(float)
    assert not np.isnan(got).any()
    assert (got >= larger - room).all()
    assert (got <= smaller + np.where(np.isfinite(smaller), tight * smaller, 0.0)).all()
    assert (frame.alpha == np.isfinite(frame.depth)).all()
    assert np.isfinite(frame.color).all()
    return frame


def middle(frame, shape, depth):
    if isinstance(frame, Camera):
        return frame.center + depth * frame.world_from_pixel @ (shape[1] / 2, shape[0] / 2, 1)
    return frame.origin + frame.a * shape[1] / 2 + frame.b * shape[0] / 2 + frame.f * depth


@pytest.mark.parametrize("shape", [(9, 13), (2, 2), (2, 17), (33, 5)])
@pytest.mark.parametrize("frame", [PLAIN, SKEW], ids=["plain", "skew"])
@pytest.mark.parametrize("holes", [0.0, 0.15])
def test_relief_equals_brute_force(shape, frame, holes):
    rng = np.random.default_rng(7)
    height = rng.random(shape) * 3
    height[rng.random(shape) < holes] = np.nan
    target = middle(frame, shape, 1.5)
    for way in ((1, 2, 5), (-4, 1, -3), (3, -5, 0.7)):
        check(relief(frame, height), Camera.look_at(target + 2.5 * np.array(way), target, width=44, height=36))


@pytest.mark.parametrize("column", [-60.0, 20.0, 100.0])
@pytest.mark.parametrize("row", [-50.0, 15.0, 80.0])
@pytest.mark.parametrize("below", [False, True])
def test_every_epipole_region(column, row, below):
    """The epipole, where f vanishes, is left of, in, right of, above and below the picture, from above and below."""
    rng = np.random.default_rng(3)
    source = relief(PLAIN, rng.random((24, 24)) * 2)
    # the direction f is at pixel (column, row): a rotation that takes f there
    K = np.array([[40.0, 0, 20], [0, 40, 15], [0, 0, 1]])
    f = np.linalg.inv(K) @ (column, row, 1.0) * (1.0 if below else -1.0)
    f /= np.linalg.norm(f)
    right = np.cross((0, 1, 0.2), f)
    right /= np.linalg.norm(right)
    R = np.stack([right, np.cross(f, right), f], axis=1)
    seen = np.linalg.inv(K) @ (20, 15, 1.0) @ R  # the middle pixel's direction
    eye = np.array([12, 12, 1.0]) - 22 * seen / np.linalg.norm(seen)
    camera = Camera(K, np.c_[R, -R @ eye], 40, 30)
    frame = check(source, camera, flips=0.03)
    assert frame.stats["hits"] > 20


def test_epipole_at_infinity_and_on_pixel_centres():
    rng = np.random.default_rng(3)
    source = relief(PLAIN, rng.random((24, 30)) * 2)
    sideways = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])  # looks along v: f vanishes at infinity
    for eye in ((15.0, -8.0, 1.2), (15.5, -8.0, 0.7)):
        check(source, Camera([[30, 0, 20], [0, 30, 15], [0, 0, 1]], np.c_[sideways, -sideways @ eye], 40, 30), 0.1)
    down = np.diag([1.0, -1, -1])
    for middle_of in (20.0, 20.5):  # f vanishes at a pixel's corner, at a pixel's centre
        for eye in ((12.5, 12.5, 20), (12.0, 12.0, 20), (12.3, 11.5, 20), (-3, 5, 20)):
            K = [[30, 0, middle_of], [0, 30, middle_of], [0, 0, 1]]
            check(source, Camera(K, np.c_[down, -down @ eye], 41, 41), 0.05)


def layers_of(camera, shape, seed):
    rng = np.random.default_rng(seed)
    x, y = np.arange(shape[1]), np.arange(shape[0])[:, None]
    depth = 3 + 0.2 * np.sin(0.8 * x) + 0.1 * y + np.where((x > 5) & (y > 2), 1.5, 0.0)
    depth[rng.random(shape) < 0.1] = np.inf
    return DepthImage(camera, rng.random((*shape, 3)), depth.astype(np.float32))


@pytest.mark.parametrize(
    "shift",
    [
        (0.4, 0.1, 0.3),
        (-0.8, 0.5, 0.0),
        (0, 0, 0.7),
        (0, 0, -0.7),
        (0, 0, 0),
        (0.5, 0, 0),
        (0, -0.4, 0),
        (0.3, 0.3, -1),
    ],
)
def test_depth_images(shift):
    """Sideways, forward and backward motion, and coincident centres."""
    camera = Camera.look_at((1, 2, 3), (0.5, -1, 0), width=12, height=9)
    source = layers_of(camera, (9, 12), 0)
    moved = camera.center + camera.R.T @ np.array(shift)
    for K in (camera.resized(43, 31).K, camera.resized(80, 60).K):
        check(source, Camera(K, np.c_[camera.R, -camera.R @ moved], 43, 31), flips=1.0)
    target = middle(camera, (9, 12), 3.5)
    if np.any(np.array(shift) != 0):
        check(source, Camera.look_at(moved, target, up=(0.3, 1, 0.4), width=36, height=30), flips=1.0)


def test_layered_images_equal_ldi():
    rng = np.random.default_rng(4)
    counts = rng.integers(0, 4, 80)
    ends = np.cumsum(counts).reshape(8, 10)
    offsets = np.concatenate([np.r_[0, ends[:-1, -1]][:, None], ends], 1)
    depth = np.concatenate([np.sort(rng.random(k) * 3) for k in counts])
    normal = rng.normal(size=(len(depth), 3)) * 0.3 - (0, 0, 1)
    source = ibrpipe.LayeredDepthImage(PLAIN, offsets, depth, rng.random((len(depth), 3)), normal)
    for eye in ((2, 1, -9), (5, 4, -7), (-8, 4, -3)):
        check(source, Camera.look_at(eye, (5, 4, 1.5), width=40, height=30))


def test_maps_are_composited_by_depth():
    rng = np.random.default_rng(5)
    camera = Camera.look_at((6, -9, 12), (6, 6, 0.5), width=50, height=40)
    low, high = relief(PLAIN, rng.random((12, 12))), relief(PLAIN, rng.random((12, 12)) + 0.4)
    both = ibrpipe.render([low, high], camera, "epipolar")
    apart = [ibrpipe.render(part, camera, "epipolar").depth for part in (low, high)]
    np.testing.assert_array_equal(both.depth, np.minimum(*apart))
    np.testing.assert_array_equal(both.color, ibrpipe.render([low, high], camera).color)


def test_thread_count_changes_no_byte():
    rng = np.random.default_rng(6)
    camera = Camera.look_at((12, -8, 25), (10, 10, 3), width=101, height=67)
    own = Camera.look_at((1, 2, 3), (0.5, -1, 0), width=12, height=9)
    source = ibrpipe.prepare([relief(SKEW, rng.random((40, 50)) * 3), layers_of(own, (9, 12), 1)], "epipolar")

    def compute():
        frame = ibrpipe.render(source, camera, "epipolar")
        return frame.depth, frame.color

    on_all_thread_counts(compute)


@pytest.mark.parametrize("width", [1e-6, 1e6])
def test_tiny_and_huge(width):
    scale = width / 16
    rng = np.random.default_rng(4)
    source = relief(ParallelFrame((0, 0, 0), (scale, 0, 0), (0, scale, 0), (0, 0, 1)), rng.random((16, 16)) * 2 * scale)
    target = scale * np.array([8, 8, 1.0])
    check(source, Camera.look_at(target + scale * np.array([5, 9, 20]), target, width=40, height=30))
    check(
        source, Camera.look_at(target + scale * np.array([3, 1, 9e5]), target, fov_y_deg=0.001, width=40, height=30), 1
    )


@pytest.mark.parametrize("scale", [1.0, 300.0, 3e5])
def test_lines_wider_than_the_map(scale):
    """Cells far smaller than a pixel, and far narrower than long: blocks end at the one that holds all cells."""
    rng = np.random.default_rng(8)
    frame = ParallelFrame((0, 0, 0), (1, 0, 0), (0, scale, 0), (0, 0, 1))
    source = relief(frame, rng.random((12, 14)))
    for ways in ((3, 2, 4), (0.1, 4, 3)):
        target = np.array([7, 6 * scale, 0.5])
        camera = Camera.look_at(target + 6 * scale * np.array(ways), target, width=40, height=30)
        check(source, camera, flips=1.0)
        sectors, _ = epipolar_maps.sweep_map(ibrpipe.prepare(source, "epipolar").data.maps[0], camera)
        assert (sectors[:, lines.LEVEL] <= 4).all()  # 13 cells, 16, 8, 4, 2 and 1 blocks


def test_nothing_to_hit():
    camera = Camera.look_at((3, 3, -9), (3, 3, 2), width=24, height=20)
    none = LayeredDepthImage(PLAIN, np.zeros((3, 4), np.int64), np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3)))
    for source in (none, relief(PLAIN, np.full((4, 4), np.nan))):
        assert ibrpipe.render(source, camera, "epipolar").stats["hits"] == 0


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
    height = np.full((12, 15), 1.0)
    if kind == "spike":
        height[5, 6], height[8, 3] = 9.0, -6.0
    if kind == "step":
        height[:, 8:] = 4.0
    camera = Camera.look_at(eye, target, fov_y_deg=50, width=33, height=27)
    source = relief(PLAIN, height)
    larger, smaller = ldi_twin.cast(source, camera, 1e-6), ldi_twin.cast(source, camera, -1e-6)
    clear = np.isfinite(larger) & np.isclose(larger, smaller, rtol=1e-6, atol=0) & (larger > 1e-3)
    frame = ibrpipe.render(source, camera, "epipolar")
    assert not np.isnan(frame.depth).any()
    error = np.abs(frame.depth[clear] - larger[clear]) / larger[clear]
    assert (error > 1e-4).sum() <= 1
    assert (~np.isfinite(larger) & np.isfinite(frame.depth)).sum() == 0
