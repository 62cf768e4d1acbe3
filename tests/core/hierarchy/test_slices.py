"""Where slices lie: homographies and boxes against projecting the plane's points one by one."""

from __future__ import annotations

import numpy as np
import pytest

from ibrpipe.core.hierarchy import shade, slices
from ibrpipe.types.prerendered import view_axes

K = np.array([[300.0, 2.0, 160.0], [0.0, 310.0, 120.0], [0.0, 0.0, 1.0]])
SLAB = (3, 5, 7, 4)


def pose_of(seed, mirrored=False):
    rng = np.random.default_rng(seed)
    matrix = np.linalg.qr(rng.normal(size=(3, 3)))[0] * rng.uniform(0.5, 2.0, 3)
    matrix[:, 0] *= np.sign(np.linalg.det(matrix)) * (-1 if mirrored else 1)
    return np.concatenate([matrix, [[0.5], [-0.3], [14.0]]], axis=1).ravel()


def place(pose, lights=(), lighting=((1, 1, 1),), bins=0):
    draws = np.array([[0, 1 << 16 | 3, 0, 0, 100, bins]])
    tables = (
        np.array([[0.1, 0.2, -0.1, 2.0]]),
        view_axes(8),
        np.array([8, 16]),
        np.array([0.5], np.float32),
        np.array([1]),
    )
    numbers, pixels, depths = np.empty((1, 14)), np.empty((1, 8), np.int64), np.empty(1, np.float32)
    slabs, means = np.array([[*SLAB, 40, 6, 0]]), np.zeros((1, 12), np.float32)
    means[0, 4:] = 0, 0, 1, 0, 0, 0, 0, 0
    slices.place_slices(
        draws, pose[None], tables, slabs, np.array([[0.3, 0.4]], np.float32), means, (K, np.array([320.0, 240.0])),
        np.array(lights, float).reshape(-1, 3), np.array(lighting, float), numbers, pixels, depths,
    )  # fmt: skip
    return numbers[0], pixels[0], depths[0]


def project(pose, u, v, height=0.4):
    """Pixel and depth of texel coordinates u, v of the slab's grid."""
    a, b, d = view_axes(8)[3]
    point = np.array([0.1, 0.2, -0.1]) + height * d + 0.25 * ((u - 8) * a + (v - 8) * b)
    camera = pose.reshape(3, 4) @ (*point, 1)
    pixel = K @ camera
    return pixel[0] / pixel[2], pixel[1] / pixel[2], camera[2]


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("seed", range(4))
def test_pixels_find_their_texels(seed, mirrored):
    pose = pose_of(seed, mirrored)
    numbers, pixels, depth = place(pose)
    for u in (2.5, 6.0, 10.5):
        for v in (4.5, 7.0, 9.5):
            x, y, _ = project(pose, u, v)
            w = numbers[6] * x + numbers[7] * y + numbers[8]
            assert w > 0
            assert (numbers[0] * x + numbers[1] * y + numbers[2]) / w == pytest.approx(u - 3 + 0.5, abs=1e-5)
            assert (numbers[3] * x + numbers[4] * y + numbers[5]) / w == pytest.approx(v - 5 + 0.5, abs=1e-5)
            assert pixels[0] <= x <= pixels[1]
            assert pixels[2] <= y <= pixels[3]
    assert depth == pytest.approx(project(pose, 8, 8, 0.3)[2])
    assert pixels[4:7].tolist() == [106, 7, 4]
    np.testing.assert_allclose(numbers[9:12], 0.5)
    assert numbers[12] == 1.0


def test_a_part_narrower_than_a_pixel_is_drawn_as_wide_and_covers_less():
    pose = pose_of(1)
    pose[3::4] *= 300.0
    near = pose.copy()
    near[3::4] /= 300.0
    wide = 2 * 2.0 * np.linalg.norm(pose.reshape(3, 4)[:, :3], 2) * K[1, 1] / (pose[8:11] @ (0.1, 0.2, -0.1) + pose[11])
    assert wide < 0.9
    numbers, pixels, _ = place(pose)
    np.testing.assert_allclose(numbers[9:12] / 0.5, numbers[12])
    # a bound of the greatest stretch is used, which is at most 3 ** 0.5 times as large
    assert wide**2 <= numbers[12] <= 3 * wide**2
    x, _, _ = project(pose, 8, 8)
    step = np.hypot(numbers[0] / numbers[8], numbers[3] / numbers[8])  # texels a pixel, x
    plain = place(near)[0]
    assert step / (300 * np.hypot(plain[0] / plain[8], plain[3] / plain[8])) == pytest.approx(
        numbers[12] ** 0.5, rel=0.1
    )
    assert pixels[0] <= x <= pixels[1] or pixels[0] == pixels[1]


def test_a_slice_beyond_the_picture_has_no_pixels():
    pose = pose_of(0)
    pose[3] = 400.0
    _, pixels, _ = place(pose)
    assert pixels[0] >= pixels[1]


def test_gains_make_the_mean_of_a_slab_right():
    # one normal along z of the part: its shade under the true light over that under the middle of the bin
    scale = 3.0
    pose = np.concatenate([scale * np.eye(3), [[0.0], [0.0], [20.0]]], axis=1).ravel()
    light = np.array([0.3, 0.2, 0.9]) / np.linalg.norm([0.3, 0.2, 0.9])
    key = np.empty((1, 2), np.int64)
    slices.find_keys(np.zeros(1, np.int32), np.array([1 << 16 | 3], np.int32), pose[None], light[None], 2, 8, key)
    assert key[0, 0] == 1 * 8 + 3
    middle = np.empty((1, 3))
    shade.lights_of_key(int(key[0, 1]), 1, slices.BINS, middle)
    assert middle[0] @ light > 0.97
    numbers, _, _ = place(pose, [light], [(0.2, 0.2, 0.2), (0.8, 0.4, 0.0)], int(key[0, 1]))
    wanted = (0.2 + np.array([0.8, 0.4, 0]) * light[2]) / (0.2 + np.array([0.8, 0.4, 0]) * middle[0, 2])
    np.testing.assert_allclose(numbers[9:12], 0.5 * wanted, rtol=1e-4)


def test_normals_go_by_the_inverse_transpose():
    # stretched along x and tilted: a normal (1, 0, 1) of the part becomes (1/4, 0, 1)
    pose = np.concatenate([np.diag([4.0, 1.0, 1.0]), [[0.0], [0.0], [20.0]]], axis=1).ravel()
    moments = np.zeros(12, np.float32)
    moments[4:] = np.sqrt(0.5), 0, np.sqrt(0.5), 0.5, 0, 0, 0.5, 0
    light, out = np.array([[0.6, 0.0, 0.8]]), np.empty(3)
    lighting = np.array([[0.0, 0, 0], [1.0, 1, 1]])
    bins = np.array([[0.0, 0.0, 1.0]])
    inverse = np.empty((3, 3))
    slices.invert_pose(pose, inverse)
    np.testing.assert_allclose(inverse, np.linalg.inv(pose.reshape(3, 4)[:, :3]), atol=1e-12)
    work = (np.empty((1, 3)), np.empty(3), np.empty(3))
    slices.light_gains(inverse, light, bins, lighting, moments, work, out)
    true = np.array([0.25, 0, 1]) / np.linalg.norm([0.25, 0, 1])
    assert out[0] * np.sqrt(0.5) == pytest.approx(true @ light[0], rel=1e-3)


def seen_moments(normals, weights, d):
    """Moments (12,) of surfaces (N, 3) of sizes (N,) as they are seen along d, turned to the viewer."""
    turned = normals * np.sign(normals @ d)[:, None]
    share = weights * np.abs(normals @ d)
    share /= share.sum()
    mean, square = share @ turned, np.einsum("n,ni,nj->ij", share, turned, turned)
    return np.array([1, 0, 0, 0, *mean, square[0, 0], square[1, 1], square[0, 1], square[0, 2], square[1, 2]])


def cap(count, half_angle):
    """Normals (N, 3) evenly over a cap around z."""
    rng = np.random.default_rng(0)
    z, turn = rng.uniform(np.cos(half_angle), 1, count), rng.uniform(0, 2 * np.pi, count)
    r = np.sqrt(1 - z**2)
    return np.stack([r * np.cos(turn), r * np.sin(turn), z], axis=1)


# two moments tell a wall and all directions exactly; between them the spread of normals is guessed, to a tenth
@pytest.mark.parametrize(
    ("half_angle", "atol"), [(1e-3, 1e-3), (0.6, 0.1), (np.pi / 2, 0.02)], ids=["a wall", "a bush", "all directions"]
)
def test_slabs_are_as_much_thicker_at_a_slant_as_their_surfaces_are(half_angle, atol):
    d = np.array([0.0, 0.0, 1.0])
    normals = cap(40000, half_angle)
    moments = seen_moments(normals, np.ones(len(normals)), d)
    for angle in (0.0, 0.3, 0.6, 0.9):
        eye = np.array([np.sin(angle), 0.0, np.cos(angle)])
        wanted = np.abs(normals @ eye).sum() / np.abs(normals @ d).sum() / np.cos(angle)
        assert slices.thickening(eye, d, moments) == pytest.approx(wanted, abs=atol)


def test_the_eye_is_seen_from_the_middle_of_a_part():
    pose, sphere, out = pose_of(2), np.array([0.1, 0.2, -0.1, 2.0]), np.empty(3)
    slices.eye_direction(pose, sphere, out)
    matrix = pose.reshape(3, 4)
    wanted = np.linalg.solve(matrix[:, :3], -matrix[:, 3]) - sphere[:3]
    np.testing.assert_allclose(out, wanted / np.linalg.norm(wanted), atol=1e-12)
