"""The hard cases, group by group; each has a name, says what is hard, and builds what is rendered."""

from ibrpipe.bench.cases.case import (
    GROUPS,
    Case,
    CompositeCase,
    CopiesCase,
    MeshCase,
    Refusal,
    Shot,
    SpiralCase,
)
from ibrpipe.bench.cases.listing import all_cases, choose_cases

__all__ = [
    "GROUPS",
    "Case",
    "CompositeCase",
    "CopiesCase",
    "MeshCase",
    "Refusal",
    "Shot",
    "SpiralCase",
    "all_cases",
    "choose_cases",
]
