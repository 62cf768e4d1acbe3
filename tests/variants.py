"""`--variants N` runs at most N variants of each parametrised test, spread evenly over all of them."""

from __future__ import annotations

from collections import defaultdict

import pytest


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the option."""
    parser.addoption("--variants", type=int, default=0, help="of each parametrised test at most so many; 0 = all")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out what is too many, and tell it as deselected."""
    most = config.getoption("--variants")
    if most:
        left = chosen([item.nodeid for item in items], most)
        config.hook.pytest_deselected(items=[item for item in items if item.nodeid not in left])
        items[:] = [item for item in items if item.nodeid in left]


def chosen(names: list[str], most: int) -> set[str]:
    """Return the names of tests that stay: `most` of those that differ in their parameters only, first and last too."""
    tests = defaultdict(list)
    for name in names:
        tests[name.partition("[")[0]].append(name)
    kept = set()
    for variants in tests.values():
        count, steps = len(variants), max(min(most, len(variants)) - 1, 1)
        kept.update(variants[n * (count - 1) // steps] for n in range(min(most, count)))
    return kept
