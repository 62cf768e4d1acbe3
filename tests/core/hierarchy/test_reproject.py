"""The published reprojection against a picture made sample by sample."""

from __future__ import annotations

import numpy as np
import pytest

from ibrpipe.core.hierarchy import reproject

K = np.array([[40.0, 0.0, 16.0], [0.0, 42.0, 12.0], [0.0, 0.0, 1.0]])


def scattered(seed=0):
    rng = np.random.default_rng(seed)
    places = rng.uniform(-1, 1, (30, 3)).astype(np.float32)
    poses = []
    for x, y, scale in ((0, 0, 1), (1, 0.5, 0.5), (-1, 0, -1.5)):
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0] * scale
        poses.append(np.concatenate([turn, [[x], [y], [6.0]]], axis=1).ravel())
    draws = np.array([[0, 10, 0], [10, 20, 10], [0, 10, 30]])
    return draws, np.stack(poses), np.array([0.3, 0.2, 0.6]), places


def cast(chunks, draws, poses, widths, places):
    depth = np.full((chunks, 24, 32), np.inf, np.float32)
    ids = np.full((chunks, 24, 32), reproject.NOTHING, np.int64)
    reproject.reproject(draws, poses, widths, places, K, 0.1, depth, ids)
    reproject.merge(depth, ids)
    return depth[0], ids[0]


def twin(draws, poses, widths, places):
    depth, ids = np.full((24, 32), np.inf, np.float32), np.full((24, 32), -1)
    for i, (first, count, number) in enumerate(draws):
        for n in range(count):
            x, y, z = poses[i].reshape(3, 4) @ (*places[first + n].astype(float), 1)
            column, row = 40 * x / z + 16, 42 * y / z + 12
            half = max(widths[i] * 42 / z / 2, 0.5)
            for r in range(24):
                for c in range(32):
                    inside = column - half <= c + 0.5 < column + half and row - half <= r + 0.5 < row + half
                    if z > 0.1 and inside and np.float32(z) < depth[r, c]:
                        depth[r, c], ids[r, c] = z, number + n
    return depth, ids


@pytest.mark.parametrize("chunks", [1, 3])
def test_the_nearest_sample_of_every_pixel_is_found(chunks):
    depth, ids = cast(chunks, *scattered())
    wanted_depth, wanted = twin(*scattered())
    assert (wanted >= 0).sum() > 100
    np.testing.assert_array_equal(ids, wanted)
    np.testing.assert_allclose(depth, wanted_depth, rtol=1e-6)


def test_equal_depths_go_to_the_lesser_number():
    pose = np.eye(4)[:3].reshape(1, 12)
    place = np.array([[0, 0, 5.0], [0, 0, 5.0]], np.float32)
    draws = np.array([[0, 1, 0], [1, 1, 1]])
    for order in ([0, 1], [1, 0]):
        _, ids = cast(2, draws[order], np.repeat(pose, 2, axis=0), np.array([1.0, 1.0]), place)
        assert set(np.unique(ids)) == {-1, 0}


def test_samples_are_lit_under_the_inverse_transpose():
    draws, poses, widths, places = scattered()
    poses[1, :3] *= 2.0  # no similarity any more
    _, ids = cast(1, draws, poses, widths, places)
    rng = np.random.default_rng(1)
    albedo, normals = rng.random((30, 3)).astype(np.float32), rng.normal(size=(30, 3)).astype(np.float32)
    lights = np.array([[0, 0, -1.0], [0.6, 0, 0.8]])
    lighting = np.array([[0.1, 0.2, 0.3], [0.5, 0.5, 0.5], [0.3, 0.0, 0.9]])
    color = np.zeros((24, 32, 3), np.float32)
    reproject.shade_samples(ids, draws, poses, (albedo, normals), lights, lighting, np.linalg.inv(K), color)
    assert not color[ids < 0].any()
    for row, column in np.argwhere(ids >= 0)[::7]:
        i = int(np.searchsorted(draws[:, 2], ids[row, column], side="right")) - 1
        s = draws[i, 0] + ids[row, column] - draws[i, 2]
        normal = np.linalg.inv(poses[i].reshape(3, 4)[:, :3]).T @ normals[s]
        normal /= np.linalg.norm(normal)
        if normal @ np.linalg.solve(K, (column + 0.5, row + 0.5, 1)) > 0:
            normal = -normal
        light = lighting[0] + np.maximum(lights @ normal, 0) @ lighting[1:]
        np.testing.assert_allclose(color[row, column], albedo[s] * light, atol=1e-5)
