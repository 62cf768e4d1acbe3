"""`--variants` keeps every test, and of its variants as many as asked for."""

from __future__ import annotations

import pytest
from variants import chosen

NAMES = ["a.py::one", *(f"a.py::two[{n}]" for n in range(9)), "b.py::two[0]", "b.py::two[1]"]


@pytest.mark.parametrize(
    ("most", "left"),
    [(1, {"two[0]"}), (2, {"two[0]", "two[8]"}), (3, {"two[0]", "two[4]", "two[8]"}), (9, set()), (50, set())],
)
def test_variants_are_spread_from_the_first_to_the_last(most: int, left: set[str]) -> None:
    kept = chosen(NAMES, most)
    assert {name for name in kept if name.startswith("a.py::two")} == (
        {f"a.py::{name}" for name in left} or {name for name in NAMES if name.startswith("a.py::two")}
    )
    assert "a.py::one" in kept
    assert sum(name.startswith("b.py") for name in kept) == min(most, 2)
