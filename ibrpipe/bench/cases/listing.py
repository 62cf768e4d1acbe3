"""All hard cases, and the choice among them by name."""

from __future__ import annotations

from collections.abc import Sequence
from fnmatch import fnmatchcase

from ibrpipe.bench.cases.case import GROUPS, AnyCase
from ibrpipe.bench.cases.composites import composite_cases
from ibrpipe.bench.cases.copies import copies_cases
from ibrpipe.bench.cases.eyes import epipole_cases, eye_cases, ray_cases
from ibrpipe.bench.cases.meshes import mesh_cases
from ibrpipe.bench.cases.spirals import spiral_cases
from ibrpipe.bench.cases.surfaces import bit_cases, frame_cases, scale_cases, shape_cases, value_cases
from ibrpipe.errors import ConfigError

_MAKERS = (
    eye_cases, epipole_cases, ray_cases, shape_cases, composite_cases, scale_cases, bit_cases, spiral_cases,
    frame_cases, value_cases, mesh_cases, copies_cases,
)  # fmt: skip


def all_cases() -> list[AnyCase]:
    """Return every case, group by group."""
    return [case for maker in _MAKERS for case in maker()]


def choose_cases(patterns: Sequence[str] = ()) -> list[AnyCase]:
    """Return the cases whose names fit one of the patterns (``*`` and ``?``), or whose group is named by its number.

    Raises
    ------
    ConfigError
        A pattern fits nothing.
    """
    known = all_cases()
    if not patterns:
        return known
    chosen: list[AnyCase] = []
    for pattern in patterns:
        fitting = [case for case in known if fnmatchcase(case.name, pattern) or pattern == str(case.group)]
        if not fitting:
            raise ConfigError(
                f"no hard case is called {pattern!r}; give a name, a pattern such as 'grazing-*', or a group: "
                f"{', '.join(f'{n} ({text})' for n, text in GROUPS.items())}"
            )
        chosen += [case for case in fitting if case not in chosen]
    return chosen
