"""The quick look at a pair's matches: what has a common geometry is let through, what has none is not."""

from __future__ import annotations

import numpy as np
import pytest
from textured_corner import cameras

from ibrpipe.calibration.matching import LEAST, may_share_geometry
from ibrpipe.types import Array


def matches(seed: int, good: int, bad: int, flat: bool = False) -> tuple[Array, Array]:
    """Places in two photos of 1600 x 1200: of `good` points with a pixel's noise, and of `bad` wrong matches."""
    random = np.random.default_rng(seed)
    points = random.uniform(0.0, 1.5, (good, 3))
    points[:, 2] *= not flat
    seen = []
    for camera in cameras(2):
        local = points @ camera.R.T + camera.t
        pixels = 5.0 * (local @ camera.K.T)[:, :2] / local[:, 2:] + random.normal(0.0, 1.0, (good, 2))
        seen.append(np.concatenate([pixels, random.uniform((0, 0), (1600, 1200), (bad, 2))]))
    order = random.permutation(good + bad)
    return seen[0][order].astype(np.float32), seen[1][order].astype(np.float32)


@pytest.mark.parametrize("flat", [False, True])
@pytest.mark.parametrize("seed", range(10))
def test_a_common_geometry_is_seen_among_as_many_wrong_matches(seed: int, flat: bool) -> None:
    assert may_share_geometry(*matches(seed, 30, 30, flat))


def test_matches_by_chance_are_not_worth_a_check() -> None:
    assert sum(may_share_geometry(*matches(seed, 0, 60)) for seed in range(20)) <= 5


def test_fewer_matches_than_colmap_asks_for_are_none() -> None:
    one, other = matches(0, LEAST - 1, 0)
    assert not may_share_geometry(one, other)
    assert not may_share_geometry(one[:0], other[:0])


def test_the_answer_repeats() -> None:
    pairs = [matches(seed, 12, 25) for seed in range(12)]
    once = [may_share_geometry(*pair) for pair in pairs]
    assert [may_share_geometry(*pair) for pair in reversed(pairs)] == once[::-1]


def test_places_in_one_spot_fix_no_geometry() -> None:
    spot = np.full((40, 2), 5.0, np.float32)
    assert not may_share_geometry(spot, spot)
