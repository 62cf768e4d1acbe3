"""The residual pass of a picture against a plain twin, two textures, both codings; what must stay untouched."""

from __future__ import annotations

import numpy as np
import pytest
import spiral_twin
from kernel_runs import on_all_thread_counts

from ibrpipe.core.color import srgb_encode
from ibrpipe.core.spiral import directions
from ibrpipe.errors import RendererError
from ibrpipe.renderers.view_dependence.spiral import add, prepare
from ibrpipe.types import Camera, LayeredDepthImage, ParallelFrame, SpiralResiduals, SpiralTexture

LOW = ParallelFrame((-1, -1, -1), (2, 0, 0), (0, 2, 0), (0, 0, 1))
SIDE = ParallelFrame((-1, -1, 1), (0, 0, -2), (0, 2, 0), (1, 0, 0))
CAMERA = Camera.look_at((-2.2, 0.4, -3.1), (0, 0, 0), fov_y_deg=35, width=11, height=9)


def residuals(frame=LOW, k=1 / 4, seed=70, zero=32, closed=True, dtype=np.uint8, valid=0.8):
    rng = np.random.default_rng(seed)
    alphas = directions.table(k, closed)
    ways = directions.directions(alphas, k, directions.LIMIT if closed else np.pi / 2)
    sizes = rng.integers(1, 7, (len(ways), 2)).astype(np.int32)
    starts = np.concatenate([[0], np.cumsum(sizes.astype(np.int64).prod(axis=1))])
    texels = rng.integers(0, 100, (starts[-1], 3)) if dtype == np.uint8 else rng.normal(0, 0.2, (starts[-1], 3))
    seen = rng.random(starts[-1]) < valid
    return SpiralResiduals(frame, k, alphas, ways, sizes, starts, texels.astype(dtype), seen, zero, closed)


def picture(seed=71):
    """(color, depth) of a surface around the origin, with holes."""
    rng = np.random.default_rng(seed)
    depth = rng.uniform(3.0, 4.6, (9, 11)).astype(np.float32)
    depth[rng.random(depth.shape) < 0.2] = np.inf
    return rng.uniform(0, 1.2, (9, 11, 3)).astype(np.float32), depth


def with_residuals(members, color, depth, camera=CAMERA):
    layers = LayeredDepthImage(LOW, np.zeros((1, 2)), np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3)))
    tables = prepare([SpiralTexture(layers, member) for member in members])
    out = color.copy()
    return out, add(tables, out, depth, camera)


@pytest.mark.parametrize("dtype", [np.uint8, np.float32])
@pytest.mark.parametrize("closed", [True, False])
@pytest.mark.parametrize("k", [1 / 4, 1 / 24])
def test_two_textures_as_twin_whatever_the_threads(dtype, closed, k):
    zeros = (32, 90) if dtype == np.uint8 else (0, 0)
    members = [
        residuals(LOW, k, zero=zeros[0], dtype=dtype, closed=closed),
        residuals(SIDE, 1 / 5, 72, zeros[1], dtype=dtype, closed=closed),
    ]
    color, depth = picture()
    out, lost = on_all_thread_counts(lambda: with_residuals(members, color, depth))
    wanted, lost_too = spiral_twin.shaded(color, depth, CAMERA, members, dtype == np.uint8)
    np.testing.assert_allclose(out, wanted, atol=2e-5)
    assert lost == lost_too
    assert np.abs(out - color).max() > 0.05


def test_what_is_not_hit_stays_as_it_is():
    color, depth = picture()
    out, _ = with_residuals([residuals()], color, depth)
    np.testing.assert_array_equal(out[np.isinf(depth)], color[np.isinf(depth)])


def test_residuals_of_nothing_change_nothing():
    member = residuals(zero=32)
    member.texels[:] = 32
    color, depth = picture()
    out, _ = with_residuals([member], color, depth)
    np.testing.assert_allclose(out, color, atol=3e-6)


def test_a_constant_residual_is_added_everywhere_however_many_texels_miss():
    """Weights are normalised over what is there, so holes do not darken; 20 codes are 20 codes."""
    member = residuals(zero=32, valid=0.5)
    member.texels[:] = 52
    color, depth = picture()
    color = np.clip(color, 0.05, 0.8)
    out, lost = with_residuals([member], color, depth)
    changed = (out != color).any(axis=-1)
    assert changed.sum() == np.isfinite(depth).sum() - lost
    assert changed.sum() > 50
    np.testing.assert_allclose(255 * (srgb_encode(out) - srgb_encode(color))[changed], 20, atol=2e-3)


def test_dark_colours_never_turn_negative():
    member = residuals(zero=200)
    color, depth = picture()
    out, _ = with_residuals([member], np.minimum(color, 0.01), depth)
    assert out.min() == 0
    linear = residuals(zero=0, dtype=np.float32)
    linear.texels[:] = -5
    out, _ = with_residuals([linear], color, depth)
    assert out.min() == 0


def test_without_valid_residuals_every_hit_is_counted():
    color, depth = picture()
    out, lost = with_residuals([residuals(valid=-1)], color, depth)
    np.testing.assert_array_equal(out, color)
    assert lost == np.isfinite(depth).sum()


def test_a_texture_seen_from_behind_says_nothing():
    color, depth = picture()
    behind = Camera.look_at((0, 0, 4), (0, 0, 0), fov_y_deg=35, width=11, height=9)
    out, lost = with_residuals([residuals()], color, depth, behind)
    np.testing.assert_array_equal(out, color)
    assert lost == np.isfinite(depth).sum()


def test_a_picture_without_hits():
    color, depth = picture()
    out, lost = with_residuals([residuals()], color, np.full_like(depth, np.inf))
    np.testing.assert_array_equal(out, color)
    assert lost == 0


def test_two_codings_cannot_be_mixed():
    layers = LayeredDepthImage(LOW, np.zeros((1, 2)), np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3)))
    kinds = (residuals(), residuals(dtype=np.float32, zero=0))
    with pytest.raises(RendererError, match="encode them alike"):
        prepare([SpiralTexture(layers, kind) for kind in kinds])
