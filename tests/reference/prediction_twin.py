"""Slow plain twin of the prediction of whole numbers: dictionaries of what is known, one texel after the other."""

from __future__ import annotations


def differences(values, there, median):
    """Differences (list of int) of the texels that are there, row by row, from what their neighbours foretell."""
    known, found, last = {}, [], 0
    for place in sorted((i, j) for i, row in enumerate(there) for j, is_there in enumerate(row) if is_there):
        found.append(int(values[place]) - guess(known, place, last, median))
        last = known[place] = int(values[place])
    return found


def guess(known, place, last, median):
    i, j = place
    left, upper, corner = known.get((i, j - 1)), known.get((i - 1, j)), known.get((i - 1, j - 1))
    if left is not None and upper is not None:
        if corner is None:
            return (left + upper) // 2
        plane = left + upper - corner
        return sorted([left, upper, plane])[1] if median else plane
    for each in (left, upper, known.get((i - 1, j + 1)), last):
        if each is not None:
            return each
    raise AssertionError("unreachable")
