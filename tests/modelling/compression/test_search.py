"""The choice that keeps a promise, although what is expected is wrong."""

from __future__ import annotations

import pytest

from ibrpipe.modelling.compression.search import coarsest_within, finest_within
from ibrpipe.modelling.compression.tradeoff import Choice

LADDER = [Choice({}, 1000.0 - 50 * n, 0.01 * n * n) for n in range(16)]


def attempts(scale: float, shift: float, asked: list[int]):
    def attempt(place: int) -> tuple[int, float]:
        asked.append(place)
        return int(LADDER[place].size + shift), scale * LADDER[place].error

    return attempt


@pytest.mark.parametrize("scale", [0.3, 1.0, 1.5, 4.0])
@pytest.mark.parametrize("allowed", [0.05, 0.4, 1.5])
def test_no_more_is_lost_than_allowed(scale: float, allowed: float) -> None:
    asked: list[int] = []
    found = coarsest_within(LADDER, allowed, attempts(scale, 0, asked))
    assert found is not None
    assert scale * LADDER[found].error <= allowed
    assert len(asked) <= 7
    best = max(n for n in range(16) if scale * LADDER[n].error <= allowed)
    assert best - 5 <= found <= best
    if scale == 1.0:
        assert found == best


@pytest.mark.parametrize("shift", [-120.0, 0.0, 260.0])
@pytest.mark.parametrize("most", [420, 700, 990])
def test_no_more_bytes_than_allowed(shift: float, most: int) -> None:
    asked: list[int] = []
    found = finest_within(LADDER, most, attempts(1.0, shift, asked))
    assert found is not None or LADDER[-1].size + shift > most
    if found is not None:
        assert LADDER[found].size + shift <= most
        assert found == 0 or LADDER[found - 1].size + shift > 0.8 * most
    assert len(asked) <= 7


def test_what_cannot_be_kept() -> None:
    assert coarsest_within(LADDER, -0.001, attempts(1.0, 0, [])) is None
    assert finest_within(LADDER, 10, attempts(1.0, 0, [])) is None
