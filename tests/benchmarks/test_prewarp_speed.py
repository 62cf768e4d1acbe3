"""Speed of `prewarp` beside cv2.remap: both passes on a smooth field, and whole frames.

Run with ``pytest tests/benchmarks/test_prewarp_speed.py --benchmark-only``. Both passes resample 1024 x 1024 texels to
as many pixels; `cv2.remap` does the same to 8-bit RGBA along the same shifts.
"""

from __future__ import annotations

import cv2
import numpy as np
import pytest

import ibrpipe
from ibrpipe.renderers.prewarp.faces import plane_face, sight, wide_plane
from ibrpipe.renderers.prewarp.passes import Settings, warp_face
from ibrpipe.renderers.prewarp.source import build_relief
from ibrpipe.types import Camera, ParallelFrame, ReliefTexture

N = 1024
EYE = (0.42, 0.37, 1.3)


@pytest.fixture(scope="module")
def relief():
    """A smooth field of 1024 x 1024 texels, heights 0 to 0.06 of its width."""
    y, x = np.mgrid[:N, :N] / N
    height = 0.03 + 0.03 * np.sin(19 * x + 1) * np.cos(17 * y)
    color = 0.5 + 0.4 * np.stack([np.sin(60 * x), np.cos(50 * y), np.sin(40 * (x + y))], axis=2)
    frame = ParallelFrame((0, 0, 0), (1 / N, 0, 0), (0, 1 / N, 0), (0, 0, 1))
    return ReliefTexture(frame, color, height)


def camera(width=1280, height=960):
    return Camera.look_at(EYE, (0.5, 0.5, 0), (0, 1, 0), 44.0, width, height)


@pytest.mark.parametrize("bits", [32, 8])
@pytest.mark.parametrize("method", ["two-pass", "pipelined"])
@pytest.mark.benchmark(group="both passes, 1024 x 1024")
def test_both_passes(benchmark, relief, method, bits):
    source = build_relief(relief)
    view = sight(relief.frame, camera())
    face = plane_face(view, N, N, 0.0)
    benchmark.pedantic(warp_face, (source, view, face, Settings(method, bits)), rounds=21, warmup_rounds=2)


@pytest.mark.benchmark(group="both passes, 1024 x 1024")
def test_remap(benchmark, relief):
    image = np.random.default_rng(0).integers(0, 256, (N, N, 4), np.uint8)
    shift = relief.height / (EYE[2] - relief.height)
    y, x = np.mgrid[:N, :N] + 0.5
    at = [(c + (c - N * e) * shift - 0.5).astype(np.float32) for c, e in ((x, EYE[0]), (y, EYE[1]))]
    benchmark.pedantic(cv2.remap, (image, *at, cv2.INTER_LINEAR), rounds=21, warmup_rounds=2)


@pytest.mark.parametrize("options", [{}, {"depth_bits": 8}, {"method": "pipelined"}, {"filter": "area"},
                                     {"method": "pipelined", "filter": "area"}], ids=str)  # fmt: skip
@pytest.mark.parametrize("outputs", ["depth", "color"])
@pytest.mark.benchmark(group="whole frames, 1280 x 960")
def test_frame(benchmark, relief, options, outputs):
    prepared = ibrpipe.prepare(relief, "prewarp")
    wanted = {"outputs": ("color", "depth") if outputs == "color" else "depth", "level": 0, **options}
    benchmark.pedantic(ibrpipe.render, (prepared, camera(), "prewarp"), wanted, rounds=7, warmup_rounds=2)


def bricks(share):
    """N x N texels of which a share lies in mortar below flat bricks; 0 and 1: all alike."""
    y, x = (np.indices((N, N)) + 0.5) / N
    wide = 1 - np.sqrt(1 - share)
    joint = ((8 * y) % 1 < wide) | ((4 * x + 0.5 * (np.floor(8 * y) % 2)) % 1 < wide)
    height = np.where(joint, -0.02 - 0.01 * np.sin(19 * x) * np.cos(17 * y), 0.0)
    frame = ParallelFrame((0, 0, 0), (1 / N, 0, 0), (0, 1 / N, 0), (0, 0, 1))
    return ReliefTexture(frame, np.ones((N, N, 3)), height)


@pytest.mark.parametrize("share", [0.0, 0.28, 0.72, 1.0])
@pytest.mark.parametrize("method", ["two-pass", "pipelined"])
@pytest.mark.benchmark(group="pre-warp by the share of displaced texels, 1024 x 1024")
def test_displaced_share(benchmark, share, method):
    relief = bricks(share)
    source, view = build_relief(relief), sight(relief.frame, camera())
    face = wide_plane(view, N, N, source.range, 0.0)
    benchmark.pedantic(warp_face, (source, view, face, Settings(method)), rounds=21, warmup_rounds=2)
