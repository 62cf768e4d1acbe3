"""Colours of surfaces one behind another, against the sum written out."""

from __future__ import annotations

import numpy as np

from ibrpipe.core.ldi.mix import mix_levels


def twin(depths, known, colors, gap):
    """One pixel: surfaces are runs of hits less than `gap` behind their first one."""
    left, seen, light, runs = 1.0, 0.0, np.zeros(3), []
    place = depths[0]
    for depth, share, color in zip(depths, known, colors, strict=True):
        if not np.isfinite(depth):
            break
        if not runs or depth - runs[-1][0] > gap:
            left *= 1.0 - (runs[-1][1] if runs else 0.0)
            runs.append([depth, 0.0])
        more = left * max(share - runs[-1][1], 0.0)
        runs[-1][1] = max(runs[-1][1], share)
        place = depth if seen < 0.5 <= seen + more else place
        seen, light = seen + more, light + more * color
    return place, min(seen, 1.0), light / seen if seen > 0 else light


def test_levels_mix_as_written_out():
    random = np.random.default_rng(3)
    depths = np.sort(random.uniform(1, 3, (4, 9, 11)).astype(np.float32), axis=0)
    depths[random.integers(1, 5, (9, 11))[None] <= np.arange(4)[:, None, None]] = np.inf
    known = random.integers(0, 5, depths.shape).astype(np.float32) / 4
    colors = random.random((*depths.shape, 3)).astype(np.float32)
    depth, covered, color = (np.empty(shape, np.float32) for shape in ((9, 11), (9, 11), (9, 11, 3)))
    mix_levels(depths, known, colors, np.float32(0.3), depth, covered, color)
    for y, x in np.ndindex(9, 11):
        want = twin(depths[:, y, x], known[:, y, x], colors[:, y, x], 0.3)
        np.testing.assert_allclose(depth[y, x], want[0])
        np.testing.assert_allclose(covered[y, x], want[1], atol=1e-6)
        np.testing.assert_allclose(color[y, x], want[2], atol=1e-5)


def test_a_surface_in_two_textures_counts_once_and_one_behind_shares_the_rest():
    depths = np.array([1.0, 1.01, 2.0, np.inf], np.float32)[:, None, None]
    known = np.array([0.25, 0.5, 1.0, 0.0], np.float32)[:, None, None]
    colors = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [9, 9, 9]], np.float32)[:, None, None]
    depth, covered, color = (np.empty(shape, np.float32) for shape in ((1, 1), (1, 1), (1, 1, 3)))
    mix_levels(depths, known, colors, np.float32(0.1), depth, covered, color)
    np.testing.assert_allclose(color[0, 0], [0.25, 0.25, 0.5])
    assert covered[0, 0] == 1.0
    assert depth[0, 0] == np.float32(1.01)
