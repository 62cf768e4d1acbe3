"""Residuals as they are stored: 8-bit differences round a zero offset, or half floats."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ibrpipe.core.color import srgb_decode, srgb_encode
from ibrpipe.engine.memory_map import hand_back
from ibrpipe.modelling.view_dependence.sample_sets import Samples
from ibrpipe.modelling.view_dependence.spiral import UNIT, ResidualsConfig
from ibrpipe.types import Array


def code(samples: Samples, config: ResidualsConfig) -> tuple[Array, Array, int, int]:
    """Code differences; return texels (T, 3), valid (T,), zero offset and how many valid texels were clamped."""
    count = len(samples.difference)
    runs = [slice(start, min(start + UNIT, count)) for start in range(0, count, UNIT)]
    valid, clamped = np.empty(count, bool), 0
    if samples.base is not None:
        texels = np.zeros((count, 3), np.float32)
        for run in runs:
            part = Samples(samples.which, samples.difference[run], samples.base[run])
            valid[run], texels[run] = part.valid, _linear(part)
            hand_back(samples.difference)
            hand_back(samples.base)
        return texels, valid, 0, 0
    zero = _best_zero(samples, runs) if config.zero == "auto" else config.zero
    codes = np.empty((count, 3), np.uint8)
    for run in runs:
        steps, valid[run] = _steps(samples.difference[run])
        shifted = steps + zero
        clamped += int((((shifted < 0) | (shifted > 255)).any(axis=1) & valid[run]).sum())
        codes[run] = np.clip(shifted, 0, 255).astype(np.uint8)
        hand_back(samples.difference)
    return codes, valid, zero, clamped


def _linear(samples: Samples) -> Array:
    """Differences of linear light (T, 3) float32, rounded to half floats; 0 where there are none."""
    valid, texels = samples.valid, np.zeros(samples.difference.shape, np.float32)
    base = np.asarray(samples.base)[valid]
    texels[valid] = (srgb_decode(srgb_encode(base, np.inf) + samples.difference[valid]) - base).astype(np.float16)
    return texels


def _steps(difference: Array) -> tuple[Array, Array]:
    """Differences in whole 255ths (T, 3) float32, 0 where there are none, and where there are some (T,)."""
    valid = np.asarray(np.isfinite(difference).all(axis=1))
    steps = np.zeros(difference.shape, np.float32)
    steps[valid] = np.round(255 * np.asarray(difference[valid]))
    return steps, valid


def _best_zero(samples: Samples, runs: Sequence[slice]) -> int:
    """Zero offset that clamps fewest values; 32 where nothing clamps."""
    counts = np.zeros(511, np.int64)
    for run in runs:
        steps, valid = _steps(samples.difference[run])
        counts += np.bincount(np.clip(steps[valid], -255, 255).astype(np.int64).ravel() + 255, minlength=511)
        hand_back(samples.difference)
    inside = [counts[255 - zero : 511 - zero].sum() for zero in range(256)]
    best = max(inside)
    return 32 if inside[32] == best else int(np.argmax(inside))
