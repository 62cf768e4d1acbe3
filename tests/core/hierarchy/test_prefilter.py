"""Prefiltered slices against rays that try every triangle, one by one."""

from __future__ import annotations

import numpy as np
import pytest

from ibrpipe.core.hierarchy import prefilter
from ibrpipe.renderers.hierarchical.prefiltering import face_normals_of
from ibrpipe.synthetic.instanced.solids import painted_ball

NO_TOPS = np.empty((0, 0, 0, 0), np.float32)


def soup(count, seed=0):
    rng = np.random.default_rng(seed)
    corners = (rng.uniform(-0.5, 0.5, (count, 1, 3)) + rng.uniform(-0.6, 0.6, (count, 3, 3))).astype(np.float32)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return corners, rng.uniform(0, 1, (count, 3, 3)).astype(np.float32), normals.astype(np.float32)


def axes_of(d):
    d = np.asarray(d, float) / np.linalg.norm(d)
    a = np.cross((0, 0, 1.0) if abs(d[2]) < 0.9 else (1.0, 0, 0), d)
    a /= np.linalg.norm(a)
    return np.stack([a, np.cross(d, a), d])


def ray_place(i, j):
    return i + (0.5 + 0.6180339887 * j) % 1.0, j + (0.5 + 0.7548776662 * i) % 1.0


def hits_of_ray(corners, axes, radius, size, i, j):
    """All hits of ray (i, j): height along d, face, barycentric weights; nearest first."""
    px, py = ray_place(i, j)
    x, y = (px - size / 2) * 2 * radius / size, (py - size / 2) * 2 * radius / size
    origin, found = x * axes[0] + y * axes[1], []
    for f, (p, q, r) in enumerate(corners.astype(float)):
        matrix = np.stack([q - p, r - p, axes[2]], axis=1)
        if abs(np.linalg.det(matrix)) < 1e-12:
            continue
        s, t, minus = np.linalg.solve(matrix, origin - p)
        if s >= 0 and t >= 0 and s + t <= 1:
            found.append((-minus, f, s, t))
    return sorted(found, reverse=True)


def twin(corners, paints, normals, axes, radius, rays, slabs, resolution, reach):
    """Coverage, mean albedo, mean n, mean n n^T of every texel of every slab, as floats, and heights of slabs."""
    size, share = resolution * rays, np.zeros((slabs, resolution, resolution))
    cover, moments = np.zeros((slabs, resolution, resolution)), np.zeros((slabs, resolution, resolution, 11))
    heights, own = [[] for _ in range(slabs)], np.full((slabs, size, size), None)
    for j in range(size):
        for i in range(size):
            for hit in reversed(hits_of_ray(corners, axes, radius, size, i, j)):
                own[min(max(int((radius - hit[0]) / (2 * radius) * slabs), 0), slabs - 1), j, i] = hit
    if reach == 0:
        texel = 2 * radius / resolution
        first = own.copy()
        for k, j, i in np.ndindex(slabs - 1, size, size):
            if first[k, j, i] and first[k + 1, j, i] and first[k, j, i][0] - first[k + 1, j, i][0] < texel:
                own[k + 1, j, i] = None  # the other side of something thin
    shown, passed = own.copy(), np.full((resolution, resolution), rays**2)
    for k in range(slabs - 1):
        for j in range(size):
            for i in range(size):
                if own[k, j, i] is None and near_a_hit(own[k], j, i, int(reach * rays)):
                    shown[k, j, i] = own[k + 1, j, i]
    missed = np.equal(shown, None).all(axis=0).reshape(resolution, rays, resolution, rays).any(axis=(1, 3))
    for k in range(slabs):
        before = passed.copy()
        for j in range(size):
            for i in range(size):
                hit, texel = shown[k, j, i], (j // rays, i // rays)
                if reach > 0 and missed[texel] and any(each is not None for each in shown[:k, j, i]):
                    hit = None
                if hit is None:
                    continue
                passed[texel] -= reach > 0 and missed[texel]
                height, f, s, t = hit
                n = normals[f] * (1 if normals[f] @ axes[2] >= 0 else -1)
                albedo = (1 - s - t) * paints[f, 0] + s * paints[f, 1] + t * paints[f, 2]
                cover[k, j // rays, i // rays] += 1
                heights[k].append(height)
                moments[k, j // rays, i // rays] += (
                    *albedo, *n, n[0] ** 2, n[1] ** 2, n[0] * n[1], n[0] * n[2], n[1] * n[2],
                )  # fmt: skip
        share[k] = cover[k] / np.maximum(before, 1)
    moments /= np.maximum(cover, 1)[..., None]
    return share, moments, [np.mean(h) if h else np.nan for h in heights]


def near_a_hit(hits, j, i, reach):
    """Whether a ray within a square of 2 reach + 1 rays around one meets something."""
    around = hits[max(j - reach, 0) : j + reach + 1, max(i - reach, 0) : i + reach + 1]
    return reach > 0 and any(hit is not None for hit in around.ravel())


@pytest.mark.parametrize("reach", [0.0, 0.4, 1.0])
def test_texels_equal_the_rays_average(reach):
    corners, paints, normals = soup(16)
    axes = np.stack([axes_of((0.3, -0.5, 0.8)), axes_of((1, 0, 0))])
    dense, heights = np.zeros((2, 2, 4, 4, 12), np.uint8), np.empty((2, 2, 2), np.float32)
    tops = np.full((2, 2, 4, 4), np.nan, np.float32)
    prefilter.prefilter(corners, paints, normals, axes, 1.8, 3, 1.0, reach, 1.0, dense, heights, tops)
    np.testing.assert_array_equal(np.isfinite(tops), dense[..., 0] > 0)
    for d in range(2):
        cover, moments, depth = twin(corners, paints, normals, axes[d], 1.8, 3, 2, 4, reach)
        np.testing.assert_allclose(dense[d, ..., 0] / 255, cover, atol=0.51 / 255)
        there = cover > 0
        assert there.sum() >= 4
        found = dense[d][there].astype(float)
        np.testing.assert_allclose((found[:, 1:4] / 255) ** 2, moments[there][:, :3], atol=5e-3)
        np.testing.assert_allclose((found[:, 4:7] - 128) / 127, moments[there][:, 3:6], atol=0.52 / 127)
        np.testing.assert_allclose(found[:, 7:9] / 255, moments[there][:, 6:8], atol=0.52 / 255)
        np.testing.assert_allclose((found[:, 9:12] - 128) / 254, moments[there][:, 8:11], atol=0.52 / 254)
        np.testing.assert_allclose(heights[d, :, 0], depth, atol=1e-5)


def test_overlapping_slabs_of_a_wall_hide_what_is_behind():
    # a square at a slant across a border of slabs: what both slabs let through together is nothing
    square = np.array(
        [
            [[-0.4, -0.4, -0.4], [0.4, -0.4, 0.4], [0.4, 0.4, 0.4]],
            [[-0.4, -0.4, -0.4], [0.4, 0.4, 0.4], [-0.4, 0.4, -0.4]],
        ]
    )
    normal = np.array([[-1, 0, 1], [-1, 0, 1]]) / np.sqrt(2)
    leak = {}
    for reach in (0.0, 1.0):
        dense, heights = np.zeros((1, 2, 7, 7, 12), np.uint8), np.empty((1, 2, 2), np.float32)
        prefilter.prefilter(
            square.astype(np.float32), np.ones((2, 3, 3), np.float32), normal.astype(np.float32), np.eye(3)[None], 0.7,
            4, 1.0, reach, 0.0, dense, heights, NO_TOPS,
        )  # fmt: skip
        inner = dense[0, :, 2:5, 2:5, 0] / 255.0
        leak[reach] = float(((1 - inner[0]) * (1 - inner[1])).max())
    assert leak[0.0] > 0.15
    assert leak[1.0] < 0.005


def test_a_wire_thinner_than_a_texel_covers_its_share():
    for turn in (0.0, 0.03, 0.4, np.pi / 2):
        along, across = np.array([np.cos(turn), np.sin(turn), 0]), np.array([-np.sin(turn), np.cos(turn), 0])
        half = 0.008
        quad = [-along - half * across, along - half * across, along + half * across, -along + half * across]
        corners = np.array([[quad[0], quad[1], quad[2]], [quad[0], quad[2], quad[3]]], np.float32)
        dense, heights = np.zeros((1, 1, 8, 8, 12), np.uint8), np.empty((1, 1, 2), np.float32)
        normals = np.tile(np.array([0, 0, 1], np.float32), (2, 1))
        prefilter.prefilter(
            corners, np.ones((2, 3, 3), np.float32), normals, np.eye(3)[None], 1.0, 8, 1.0, 0.0, 0.0, dense, heights,
            NO_TOPS,
        )  # fmt: skip
        wanted = 2 * 2 * half / 4 * 64
        assert abs(dense[0, 0, ..., 0].sum() / 255 - wanted) < 0.35 * wanted
        assert heights[0, 0, 0] == 0


def test_boxes_and_packed_texels_are_those_that_cover():
    rng = np.random.default_rng(1)
    dense = np.zeros((2, 3, 5, 5, 12), np.uint8)
    dense[0, 1, 1:4, 2:4] = rng.integers(1, 255, (3, 2, 12))
    dense[1, 2, 4, 0] = 7
    boxes = np.empty((2, 3, 4), np.int32)
    prefilter.trim(dense, boxes)
    assert boxes[0, 1].tolist() == [2, 1, 2, 3]
    assert boxes[1, 2].tolist() == [0, 4, 1, 1]
    assert (boxes[..., 2:].prod(axis=-1) > 0).sum() == 2
    sizes = boxes[..., 2].astype(np.int64) * boxes[..., 3]
    offsets = (np.cumsum(sizes) - sizes.ravel()).reshape(sizes.shape)
    texels, means = np.empty((7, 12), np.uint8), np.empty((2, 3, 12), np.float32)
    prefilter.pack(dense, boxes, offsets, texels, means)
    np.testing.assert_array_equal(texels[:6], dense[0, 1, 1:4, 2:4].reshape(6, 12))
    assert (texels[6] == 7).all()
    weight = texels[:6, 0].astype(float)
    np.testing.assert_allclose(means[0, 1, 0], weight.mean() / 255, rtol=1e-5)
    np.testing.assert_allclose(means[0, 1, 1], (weight * (texels[:6, 1] / 255.0) ** 2).sum() / weight.sum(), rtol=1e-5)
    assert (means[0, 0] == 0).all()


@pytest.mark.parametrize("slabs", [1, 2, 3])
def test_a_ball_is_drawn_where_its_outline_is(slabs):
    ball = painted_ball(1.0, (1, 1, 1), 24).mesh
    corners = ball.vertices[ball.faces].astype(np.float32)
    normals = face_normals_of(corners)
    dense, heights = np.zeros((1, slabs, 8, 8, 12), np.uint8), np.empty((1, slabs, 2), np.float32)
    prefilter.prefilter(
        corners, np.ones_like(corners), normals, np.eye(3)[None], 1.01, 8, 1.0, 0.0, 1.0, dense, heights, NO_TOPS
    )
    middle = (slabs - 1) // 2
    assert heights[0, middle, 1] == pytest.approx(0.0, abs=0.02)
    assert heights[0, middle, 0] > 0.1  # the front of it is seen, which is nearer
    if slabs == 3:
        assert heights[0, 0, 1] == heights[0, 0, 0]  # a cap before it, without an outline


def test_an_outline_is_that_of_rays_next_to_nothing():
    corners, paints, normals = soup(16)
    axes = axes_of((0.3, -0.5, 0.8))
    size, slabs, radius = 12, 2, 1.8
    dense, heights = np.zeros((1, slabs, 4, 4, 12), np.uint8), np.empty((1, slabs, 2), np.float32)
    prefilter.prefilter(corners, paints, normals, axes[None], radius, 3, 1.0, 0.0, 0.0, dense, heights, NO_TOPS)
    hits = [[hits_of_ray(corners, axes, radius, size, i, j) for i in range(size)] for j in range(size)]
    found = [[], []]
    for j, i in np.ndindex(size, size):
        around = [(j - 1, i), (j + 1, i), (j, i - 1), (j, i + 1)]
        if all(0 <= y < size and 0 <= x < size and hits[y][x] for y, x in around):
            continue
        for k in range(slabs):
            near = [hit[0] for hit in hits[j][i] if int((radius - hit[0]) / (2 * radius) * slabs) == k]
            if near:
                through = near[0] - hits[j][i][-1][0]
                found[k].append(near[0] - (through / 2 if through < 2 * radius / slabs else 0))
    np.testing.assert_allclose(heights[0, :, 1], [np.mean(each) for each in found], atol=1e-5)
