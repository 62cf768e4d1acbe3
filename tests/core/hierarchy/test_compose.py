"""Slices made from the slices of copies against rays that meet every slice, one by one."""

from __future__ import annotations

import numpy as np
import pytest

from ibrpipe.core.hierarchy import compose, prefilter
from ibrpipe.core.hierarchy.directions import nearest_table
from ibrpipe.renderers.hierarchical.stacks import join_stacks, packed_stacks
from ibrpipe.types.prerendered import view_axes

AXES = view_axes(7)
RESOLUTIONS = np.array([2, 4, 8], np.int64)
SPHERE = np.array([0.1, -0.2, 0.3, 1.0])


def turned(angle, axis=2):
    c, s = np.cos(angle), np.sin(angle)
    out = np.eye(3)
    i, j = [n for n in range(3) if n != axis]
    out[i, i], out[i, j], out[j, i], out[j, j] = c, -s, s, c
    return out


def library():
    """A part of a few triangles at three resolutions, as `compose` takes it."""
    rng = np.random.default_rng(3)
    corners = (rng.uniform(-0.4, 0.4, (14, 1, 3)) + rng.uniform(-0.3, 0.3, (14, 3, 3))).astype(np.float32)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = (normals / np.linalg.norm(normals, axis=1, keepdims=True)).astype(np.float32)
    paints, found = rng.uniform(0, 1, (14, 3, 3)).astype(np.float32), []
    for resolution in RESOLUTIONS:
        slabs = max(1, resolution // 2)
        dense = np.zeros((len(AXES), slabs, resolution, resolution, 12), np.uint8)
        heights = np.empty((len(AXES), slabs, 2), np.float32)
        prefilter.prefilter(
            corners, paints, normals, AXES, 1.0, 3, 1.0, 0.0, 0.0, dense, heights, np.empty((0,) * 4, np.float32)
        )
        found.append(packed_stacks(0, dense, heights))
    stacks, slabs, heights, _, texels = join_stacks(found, len(AXES))
    return SPHERE[None], RESOLUTIONS, stacks, slabs, heights, texels


def bilinear(texels, slab, u, v):
    """Coverage, and coverage times albedo, n and moments, of a slab at a place; zero beyond its texels."""
    total = np.zeros(12)
    for j in range(slab[3]):
        for i in range(slab[2]):
            weight = max(0, 1 - abs(u - slab[0] - i - 0.5)) * max(0, 1 - abs(v - slab[1] - j - 0.5))
            t = texels[slab[4] + j * slab[2] + i].astype(float)
            values = [*(t[1:4] / 255) ** 2, *(t[4:7] - 128) / 127, *t[7:9] / 255, *(t[9:12] - 128) / 254]
            total += weight * t[0] / 255 * np.array([1, *values])
    return total


def turned_moments(matrix, mix):
    """Normals under the inverse transpose, their second moments of trace 1 where they had it."""
    turn = np.linalg.inv(matrix[:, :3]).T
    xx, yy, xy, xz, yz = mix[7:]
    second = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, mix[0] - xx - yy]])
    moved = turn @ second @ turn.T
    share = mix[0] / np.trace(moved)
    moved, first = share * moved, np.sqrt(share) * (turn @ mix[4:7])
    return np.array(
        [*mix[:4], *first, moved[0, 0], moved[1, 1], moved[0, 1], moved[0, 2], moved[1, 2]]
    )  # fmt: skip


def twin(matrices, sphere, axes, given, fineness, rays, slabs, resolution):
    """Coverage and moments (K, R, R, 12) of one view, as floats, and heights (K,)."""
    spheres, _, stacks, rows, heights, texels = given
    a, b, d = axes
    met = []
    for matrix in matrices.reshape(-1, 3, 4):
        toward = np.linalg.solve(matrix[:, :3], d)
        view = int(np.argmax(AXES[:, 2] @ toward / np.linalg.norm(toward)))
        need = fineness * np.sqrt(np.abs(matrix[:, :3].T @ matrix[:, :3]).sum(axis=1).max()) / sphere[3] * resolution
        level = int(np.flatnonzero(need <= RESOLUTIONS)[0]) if need <= RESOLUTIONS[-1] else len(RESOLUTIONS) - 1
        stack = level * len(AXES) + view
        for s in range(stacks[stack], stacks[stack + 1]):
            point = matrix @ np.append(spheres[0, :3] + heights[s, 1] * AXES[view, 2], 1.0) - sphere[:3]
            met.append((float(point @ d), matrix, view, RESOLUTIONS[level], rows[s], float(heights[s, 1])))
    met.sort(key=lambda each: -each[0])
    size, unit = resolution * rays, 2 * sphere[3] / (resolution * rays)
    sums, clear = np.zeros((slabs, resolution, resolution, 12)), np.ones((slabs, size, size))
    depths, weights = np.zeros(slabs), np.zeros(slabs)
    for height, matrix, view, across, row, level in met:
        k = min(max(int((sphere[3] - height) / (2 * sphere[3]) * slabs), 0), slabs - 1)
        step = 2 * spheres[0, 3] / across
        plane = np.stack([matrix[:, :3] @ AXES[view, n] * step for n in range(2)] + [-d], axis=1)
        origin = matrix @ np.append(
            spheres[0, :3] + level * AXES[view, 2] - 0.5 * across * step * AXES[view, :2].sum(axis=0), 1.0
        )
        for y in range(size):
            for x in range(size):
                start = sphere[:3] + ((x + 0.5) * unit - sphere[3]) * a + ((y + 0.5) * unit - sphere[3]) * b
                u, v, _ = np.linalg.solve(plane, start - origin)
                mix = bilinear(texels, row, u, v)
                if mix[0] > 1e-12:
                    through = clear[k, y, x]
                    sums[k, y // rays, x // rays] += through * turned_moments(matrix, mix)
                    clear[k, y, x] *= 1 - mix[0]
                    depths[k], weights[k] = depths[k] + through * mix[0] * height, weights[k] + through * mix[0]
    return sums, depths / np.where(weights > 0, weights, np.nan)


MATRICES = np.stack(
    [
        np.column_stack([0.5 * turned(0.4), (0.3, 0.1, -0.2)]),
        np.column_stack([0.6 * turned(1.1, 0), (-0.4, 0.2, 0.1)]),
        np.column_stack([turned(0.3, 1) @ np.diag([0.5, -0.4, 0.7]), (0.1, -0.4, 0.3)]),
    ]
).reshape(-1, 12)


@pytest.mark.parametrize("resolution", [2, 5])
def test_texels_equal_the_average_of_slices_met_by_rays(resolution):
    given, sphere, rays, slabs = library(), np.array([0.0, 0.1, 0.0, 1.5]), 2, 2
    dense = np.zeros((len(AXES), slabs, resolution, resolution, 12), np.uint8)
    heights = np.empty((len(AXES), slabs, 2), np.float32)
    table = nearest_table(AXES)
    copies = (np.zeros(3, np.int64), MATRICES)
    compose.compose(copies, sphere, AXES, table, given, 1.4, rays, dense, heights)
    for view in (0, 4):
        sums, depths = twin(MATRICES, sphere, AXES[view], given, 1.4, rays, slabs, resolution)
        cover = sums[..., 0] / rays**2
        there = cover * 255 >= 0.5
        assert there.sum() >= 3
        np.testing.assert_allclose(dense[view, ..., 0] / 255, cover, atol=0.52 / 255)
        found, mean = dense[view][there].astype(float), sums[there][:, 1:] / sums[there][:, :1]
        np.testing.assert_allclose(found[:, 1:4] / 255, np.sqrt(mean[:, :3]), atol=0.52 / 255)
        np.testing.assert_allclose((found[:, 4:7] - 128) / 127, mean[:, 3:6], atol=0.52 / 127)
        np.testing.assert_allclose(found[:, 7:9] / 255, mean[:, 6:8], atol=0.52 / 255)
        np.testing.assert_allclose((found[:, 9:12] - 128) / 254, mean[:, 8:11], atol=0.52 / 254)
        np.testing.assert_allclose(heights[view, :, 0], depths, atol=1e-5)


def test_flat_copies_and_parts_without_copies_are_empty():
    given, sphere = library(), np.array([0.0, 0.0, 0.0, 1.0])
    flat = np.column_stack([np.diag([1.0, 1.0, 0.0]), np.zeros(3)]).reshape(1, 12)
    for matrices in (flat, np.zeros((0, 12))):
        dense, heights = np.zeros((len(AXES), 1, 4, 4, 12), np.uint8), np.empty((len(AXES), 1, 2), np.float32)
        copies = (np.zeros(len(matrices), np.int64), matrices)
        compose.compose(copies, sphere, AXES, nearest_table(AXES), given, 1.4, 2, dense, heights)
        assert not dense.any()
        assert np.isnan(heights).all()
