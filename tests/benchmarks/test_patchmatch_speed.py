"""Throughput of the PatchMatch kernel in pixel-hypotheses per second, and its share of the machine's arithmetic.

Run with ``pytest tests/benchmarks/test_patchmatch_speed.py --benchmark-only --benchmark-json FILE``; the figures are
the `extra_info` in FILE. A pixel-hypothesis is one plane of one pixel correlated with one neighbour: 32 samples.
`FLOPS` counts the float operations that a sample needs in `core.patchmatch_cost` (an fma is 2): place 8 fma, 1
division, 4 bounds; fetch 4 fma, 5 differences; correlate 3 products and 3 sums. `INSTRUCTIONS` also counts the
conversions, shifts, masks and the gather, an fma being 1. The limit is that of a loop of nothing but fma's, measured in
the same run on as many threads.
"""

from __future__ import annotations

import time

import numpy as np
import pytest
from numba import get_num_threads, prange

from ibrpipe.core.jit import exact_kernel, fma
from ibrpipe.core.patchmatch.cost import LANES
from ibrpipe.core.patchmatch.planes import random_planes
from ibrpipe.core.patchmatch.propose import CHANGES, PLANES
from ibrpipe.core.patchmatch.sweep import sweep
from ibrpipe.reconstruction.depth.image_pyramid import packed
from ibrpipe.reconstruction.depth.patchmatch import disc, relation
from ibrpipe.types import Camera

WIDTH, HEIGHT, NEIGHBOURS, KEEP = 640, 480, 8, 3
FLOPS = (2 * 8 + 1 + 4) + (2 * 4 + 5) + (3 + 3)
INSTRUCTIONS = (8 + 1 + 4) + (5 + 2 + 4 + 1 + 6 + 3 + 3) + (3 + 3)
ROUNDS = 2_000_000
ROW = 16 * LANES


@exact_kernel
def multiply_add(rows, rounds, factor, out):
    # rows of ROW independent fma chains, `rounds` long -> out (rows,) f32
    for i in prange(rows):
        chains = np.full(ROW, np.float32(i), np.float32)
        for _ in range(rounds):
            for k in range(ROW):
                chains[k] = fma(chains[k], factor, factor)
        out[i] = chains.sum()


def peak():
    """Float operations per second of fma's alone, all threads."""
    out, rows = np.zeros(get_num_threads(), np.float32), get_num_threads()
    multiply_add(rows, 10, np.float32(0.5), out)
    best = np.inf
    for _ in range(5):
        start = time.perf_counter()
        multiply_add(rows, ROUNDS, np.float32(0.5), out)
        best = min(best, time.perf_counter() - start)
    return 2.0 * rows * ROUNDS * ROW / best


@pytest.fixture(scope="module")
def scene():
    """A picture of smooth noise, eight neighbours around it, planes at the right depth within a pixel."""
    rng = np.random.default_rng(3)
    spectrum = np.fft.rfft2(rng.standard_normal((HEIGHT, WIDTH)))
    frequency = np.hypot(np.fft.fftfreq(HEIGHT)[:, None] * HEIGHT, np.fft.rfftfreq(WIDTH)[None] * WIDTH)
    grey = np.fft.irfft2(spectrum * np.exp(-((frequency / 80) ** 2)))
    grey = np.clip(128 + 45 * grey / grey.std(), 0, 255).astype(np.float32)
    cameras = [
        Camera.look_at(place, (0, 0, 4), up=(0, -1, 0), fov_y_deg=45, width=WIDTH, height=HEIGHT)
        for place in [(0, 0, 0), *((0.4 * np.cos(a), 0.4 * np.sin(a), 0) for a in np.arange(8) * np.pi / 4)]
    ]
    views = np.stack([relation(cameras[0], camera) for camera in cameras[1:]]).astype(np.float32)
    return grey, cameras[0], views, np.stack([packed(grey)] * NEIGHBOURS)


@pytest.mark.parametrize("consistency", [0.0, 0.15])
@pytest.mark.benchmark(group="PatchMatch, half a sweep over 640 x 480, 8 neighbours")
def test_half_sweep(benchmark, scene, consistency):
    grey, camera, views, words = scene
    window, valid = disc(), np.ones((HEIGHT, WIDTH), np.uint8)
    margin = int(np.abs(window[:2]).max())
    padded = np.pad(grey, margin, constant_values=-1)
    lens = np.array([camera.K[0, 0], camera.K[1, 1], camera.K[0, 2], camera.K[1, 2]])
    others = np.full((NEIGHBOURS, WIDTH * HEIGHT), 0.25, np.float32)
    state = np.empty((4, HEIGHT, WIDTH), np.float32)
    random_planes(lens, valid, 0.24, 0.26, 1, state)
    settings = np.array([consistency, 2.0], np.float32)

    def run():
        sweep(
            (0, 5, 1, 1.0, KEEP), np.float32(1 / (32 * 12.0**2)), settings, np.array([0.24, 0.26, 0.003]), lens, window,
            padded, valid, (views, words, others), state,
        )  # fmt: skip

    benchmark.pedantic(run, rounds=5, warmup_rounds=1)
    pixels = WIDTH * HEIGHT / 2
    rate = pixels * (PLANES * NEIGHBOURS + CHANGES * KEEP) / benchmark.stats.stats.median
    limit = peak()
    facts = {
        "hypotheses_per_second": round(rate),
        "gflops": round(rate * LANES * FLOPS / 1e9, 1),
        "fma_limit_gflops": round(limit / 1e9, 1),
        "share_of_limit": round(rate * LANES * FLOPS / limit, 3),
        "share_counting_instructions": round(rate * LANES * INSTRUCTIONS / (limit / 2), 3),
        "threads": get_num_threads(),
    }
    benchmark.extra_info.update(facts)
