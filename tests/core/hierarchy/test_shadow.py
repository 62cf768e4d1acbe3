"""Shares of light against comparing depths texel by texel, and a plane that casts no shadow on itself."""

from __future__ import annotations

import numpy as np
import pytest

from ibrpipe.core.hierarchy import shadow

K = np.array([[40.0, 0.0, 6.0], [0.0, 40.0, 5.0], [0.0, 0.0, 1.0]])
VIEW = np.concatenate([np.linalg.inv(K), np.array([[0.1], [-0.2], [0.3]])], axis=1)
LIGHT = np.array([[30.0, 0.0, 4.0, 30.0], [0.0, 30.0, 4.0, 30.0], [0.1, 0.0, 0.2, 10.0]])


def twin(depth, seen, biases, footprint):
    """Share (H, W) of one light: every texel of a square of 3 around the place counts by its area within it."""
    share, size = np.ones(depth.shape), len(seen)
    for row, column in np.ndindex(*depth.shape):
        z = float(depth[row, column])
        if not np.isfinite(z):
            continue
        place = VIEW @ ((column + 0.5) * z, (row + 0.5) * z, z, 1.0)
        pu, pv, w = LIGHT @ (*place, 1.0)
        u, v = pu / w, pv / w
        if not (0 <= u < size and 0 <= v < size):
            continue
        i, j = int(u), int(v)
        steep = 0.0
        for di, dj in ((1, 0), (0, 1)):
            around = [seen[np.clip(j + s * dj, 0, size - 1), np.clip(i + s * di, 0, size - 1)] for s in (-1, 1)]
            steps = [abs(each - seen[j, i]) for each in around if np.isfinite(each) and np.isfinite(seen[j, i])]
            steep += min(steps, default=0.0)
        limit = w - biases[0] - footprint * z - min(shadow.REACH * steep, biases[1])
        lit = 0.0
        for y, x in np.ndindex(size + 4, size + 4):
            y, x = y - 2, x - 2
            across = max(min(x + 1, u + 1.5) - max(x, u - 1.5), 0.0)
            along = max(min(y + 1, v + 1.5) - max(y, v - 1.5), 0.0)
            lit += across * along * (seen[np.clip(y, 0, size - 1), np.clip(x, 0, size - 1)] >= limit)
        share[row, column] = lit / 9
    return share


@pytest.mark.parametrize("seed", range(3))
def test_shares_are_those_of_the_texels_around(seed):
    rng = np.random.default_rng(seed)
    depth = rng.uniform(1, 4, (9, 12)).astype(np.float32)
    depth[2, 3] = np.inf
    maps = rng.uniform(10, 11.5, (2, 11, 11)).astype(np.float32)
    maps[0, 4:6, 3:7] = np.inf
    biases, out = np.array([[0.1, 0.3], [0.02, 0.0]]), np.empty((2, 9, 12), np.float32)
    shadow.visibility(depth, VIEW, maps, np.stack([LIGHT] * 2), biases, 0.01, out)
    for m in range(2):
        wanted = twin(depth, maps[m], biases[m], 0.01)
        assert ((wanted > 0.05) & (wanted < 0.95)).sum() > 10
        np.testing.assert_allclose(out[m], wanted, atol=1e-5)


def test_a_slanted_plane_casts_no_shadow_on_itself():
    depth = np.full((9, 12), 2.0, np.float32)
    rows, columns = np.mgrid[:11, :11] + 0.5
    # depth that the light sees of the plane z = 2.3 of the world: (u w, v w, w) is linear in the place
    flat = LIGHT[:, [0, 1, 3]] + np.outer(LIGHT[:, 2], (0, 0, 2.3))
    place = np.stack([columns, rows, np.ones(rows.shape)], axis=-1) @ np.linalg.inv(flat).T
    seen = (1.0 / place[..., 2]).astype(np.float32)
    shares = []
    for biases in ((1e-4, 1.0), (1e-4, 0.0)):
        out = np.empty((1, 9, 12), np.float32)
        shadow.visibility(depth, VIEW, seen[None], LIGHT[None], np.array([biases]), 0.0, out)
        shares.append(out.mean())
    assert shares[0] == 1.0
    assert shares[1] < 0.9
