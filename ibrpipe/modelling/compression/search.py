"""The choice that keeps a promise of error or of bytes, by coding and measuring a few of those that are expected to."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from ibrpipe.modelling.compression.tradeoff import Choice

#: codes the asset as the choice of that index says; returns its bytes and the mean square that this added
Attempt = Callable[[int], tuple[int, float]]
#: codings that are tried where one keeps the promise, and where none does yet
_TRIED, _MOST = 4, 7
#: share of what is allowed from which on a coding is good enough
_ENOUGH = 0.8


def coarsest_within(ladder: Sequence[Choice], allowed: float, attempt: Attempt) -> int | None:
    """Return the coarsest choice found that adds at most `allowed` of error; None = none was found."""
    return _last([choice.error for choice in ladder], allowed, lambda index: attempt(index)[1])


def finest_within(ladder: Sequence[Choice], most: int, attempt: Attempt) -> int | None:
    """Return the finest choice found of at most so many bytes; None = none was found."""
    last = len(ladder) - 1
    found = _last([choice.size for choice in ladder[::-1]], float(most), lambda index: float(attempt(last - index)[0]))
    return None if found is None else last - found


def _last(expected: Sequence[float], most: float, measured: Callable[[int], float]) -> int | None:
    """Return the last index found at which what is measured is at most so much; None = none was found.

    What one has beyond what was expected of it is expected of the next one, too.
    """
    low, high, extra, index = -1, len(expected), 0.0, None
    for trial in range(_MOST):
        guess = max((n for n, value in enumerate(expected) if value + extra <= most), default=-1)
        if index is not None and low == index and guess <= index:
            break
        index = guess if low < guess < high else (low + high) // 2
        value = measured(index)
        extra = value - expected[index]
        low, high = (max(low, index), high) if value <= most else (low, min(high, index))
        if high - low <= 1 or (low >= 0 and trial + 1 >= _TRIED) or (value <= most and value >= _ENOUGH * most):
            break
    return None if low < 0 else low
