"""The `splat` renderer: samples land where they are, footprints close the picture, threads change nothing."""

from __future__ import annotations

import numpy as np
import pytest
from kernel_runs import on_all_thread_counts

import ibrpipe
from ibrpipe.errors import RendererError
from ibrpipe.types import Camera, DepthImage, ParallelFrame, ReliefTexture


def relief():
    y, x = np.mgrid[:20, :24]
    height = 1.0 + 0.3 * np.sin(0.7 * x) * np.cos(0.5 * y)
    color = np.random.default_rng(0).random((20, 24, 3))
    return ReliefTexture(ParallelFrame((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)), color, height)


def test_samples_equal_a_plain_projection():
    source, camera = relief(), Camera.look_at((12, 3, 26), (12, 10, 1), width=90, height=80)
    best = np.full((80, 90), np.inf)
    v, u = np.mgrid[:20, :24] + 0.5
    points = np.stack([u, v, source.height], -1).reshape(-1, 3).astype(float)
    local = points @ camera.R.T + camera.t
    pixel = (local / local[:, 2:]) @ camera.K.T
    for (x, y, _), z in zip(pixel, local[:, 2], strict=True):
        if 0 <= x < 90 and 0 <= y < 80:
            best[int(y), int(x)] = min(best[int(y), int(x)], z)
    got = ibrpipe.render(source, camera, "splat", footprint=0.6).depth
    there = np.isfinite(best)
    assert there.sum() > 300
    covered = np.isfinite(got)
    near = np.isclose(got[there & covered], best[there & covered], atol=0.7)
    assert near.mean() > 0.99
    assert covered.sum() > there.sum()


def test_footprints_close_the_picture_of_a_plane():
    camera = Camera.look_at((0, 0, -3), (0, 0, 0), width=30, height=30)
    source = DepthImage(camera, np.full((30, 30, 3), 0.25), np.full((30, 30), 3.0, np.float32))
    own = ibrpipe.render(source, camera, "splat")
    np.testing.assert_allclose(own.depth, 3.0, rtol=1e-5)
    np.testing.assert_array_equal(own.color, np.float32(0.25))
    nearer = Camera.look_at((0, 0, -1.5), (0, 0, 0), width=30, height=30)
    assert np.isfinite(ibrpipe.render(source, nearer, "splat", footprint=1.05).depth).all()
    assert not np.isfinite(ibrpipe.render(source, nearer, "splat", footprint=0.5).depth).all()


def test_threads_and_options():
    source, camera = ibrpipe.prepare(relief(), "splat"), Camera.look_at((12, 3, 26), (12, 10, 1), width=90, height=80)

    def compute():
        frame = ibrpipe.render(source, camera, "splat")
        return frame.depth, frame.color

    on_all_thread_counts(compute)
    with pytest.raises(RendererError, match="0 to 16"):
        ibrpipe.render(source, camera, "splat", footprint=-1)
