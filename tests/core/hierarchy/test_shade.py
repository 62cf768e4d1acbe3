"""Light on prefiltered texels against averages over many normals."""

from __future__ import annotations

import numpy as np
import pytest

from ibrpipe.core.hierarchy import shade


def moments_of(normals):
    n = normals
    second = [(n[:, i] * n[:, j]).mean() for i, j in ((0, 0), (1, 1), (0, 1), (0, 2), (1, 2))]
    return np.array([1.0, 0.5, 0.4, 0.3, *n.mean(axis=0), *second])


def spread_normals(spread, seed=0):
    n = np.array([0.2, -0.3, 0.9]) + spread * np.random.default_rng(seed).normal(size=(4000, 3))
    return n / np.linalg.norm(n, axis=1, keepdims=True)


@pytest.mark.parametrize("spread", [0.0, 0.1, 0.5, 2.0])
@pytest.mark.parametrize("light", [(0, 0, 1.0), (1.0, 0, 0), (-0.6, 0.0, -0.8), (0.48, 0.6, 0.64)])
def test_the_mean_cosine_is_that_of_the_normals(spread, light):
    normals = spread_normals(spread)
    wanted = np.maximum(normals @ light, 0).mean()
    assert abs(shade.mean_cosine(moments_of(normals), 4, *light) - wanted) < 0.03


def test_one_normal_is_lit_exactly():
    for n in ((0, 0, 1.0), (0.6, 0, 0.8), (0, -1.0, 0)):
        moments = moments_of(np.array([n]))
        assert shade.mean_cosine(moments, 4, 0, 0, 1.0) == pytest.approx(max(n[2], 0), abs=1e-5)


def test_a_highlight_widens_with_the_spread_of_normals():
    sharp, wide = moments_of(spread_normals(0.0)), moments_of(spread_normals(0.3))
    along = np.array([0.2, -0.3, 0.9]) / np.linalg.norm([0.2, -0.3, 0.9])
    away = np.array([0.2, -0.3, 0.2]) / np.linalg.norm([0.2, -0.3, 0.2])
    assert shade.mean_highlight(sharp, 4, *along, 64.0) > 2 * shade.mean_highlight(wide, 4, *along, 64.0)
    assert shade.mean_highlight(sharp, 4, *away, 64.0) < shade.mean_highlight(wide, 4, *away, 64.0)
    assert shade.mean_highlight(sharp, 4, *-along, 64.0) == 0.0


def test_bins_lie_in_their_own_cells():
    from ibrpipe.core.hierarchy.traverse import octahedral_cell

    out = np.empty((2, 3))
    for cell in range(256):
        shade.lights_of_key(cell | (255 - cell) << 8, 2, 16, out)
        np.testing.assert_allclose(np.linalg.norm(out, axis=1), 1.0)
        assert octahedral_cell(*out[0], 16) == cell
        assert octahedral_cell(*out[1], 16) == 255 - cell


def twin_texel(texel, lights, lighting, viewer, material):
    """Straight colour of one texel."""
    m = np.empty(12)
    shade.texel_moments(texel[None], 0, 2.0, m)
    light = lighting[0] + sum(
        color * shade.mean_cosine(m, 4, *direction) for color, direction in zip(lighting[1:], lights)
    )
    light = light * m[1:4]
    for color, direction in zip(lighting[1:], lights):
        h = (direction + viewer) / np.linalg.norm(direction + viewer)
        light = light + material[0] * color * shade.mean_highlight(m, 4, *h, material[1])
    return m[0], light


@pytest.mark.parametrize("material", [(0.0, 1.0), (0.5, 20.0)])
def test_stacks_are_shaded_texel_by_texel(material):
    rng = np.random.default_rng(4)
    texels = rng.integers(60, 200, (9, 12)).astype(np.uint8)
    texels[4, 0] = 0
    # stack 0: nothing, stack 1: two slabs of 2 x 3 and 3 x 1
    slabs = np.array([[0, 0, 2, 3, 0, 0, 0], [0, 0, 3, 1, 6, 20, 0]])
    stacks, key = np.array([0, 0, 2]), 17 | 200 << 8
    lighting = np.array([[0.3, 0.2, 0.1], [0.5, 0.5, 0.5], [0.2, 0.0, 0.4]])
    viewers = np.array([[1.0, 0, 0], [0, 0, 1.0]])
    out, peaks = np.full(5 + 35, 9, np.uint32), np.empty(1, np.float32)
    shade.shade_stacks(
        np.array([[1, key]]), np.array([5]), stacks, slabs, texels, np.array([material]), viewers, lighting, 2.0, out,
        peaks,
    )  # fmt: skip
    lights = np.empty((2, 3))
    shade.lights_of_key(key, 2, 16, lights)
    wanted = [twin_texel(texel, lights, lighting, viewers[1], material) for texel in texels]
    covered = [light for cover, light in wanted if cover > 0]
    np.testing.assert_allclose(peaks[0], np.max(covered), rtol=1e-6)
    assert (out[:5] == 9).all()
    first, second = out[5:25].reshape(5, 4), out[25:40].reshape(3, 5)
    grid = np.concatenate([first[1:-1, 1:-1].ravel(), second[1:-1, 1:-1].ravel()])
    border = out[5:].astype(bool).sum()
    assert border == 8
    for code, texel, (cover, light) in zip(grid, texels, wanted):
        assert code >> 24 == texel[0]
        for c in range(3):
            assert abs(int(code >> (8 * c)) % 256 - 255 * cover * light[c] / peaks[0]) <= 0.51
