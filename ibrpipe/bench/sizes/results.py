"""What ``table2.json`` and ``growth.json`` hold."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from ibrpipe.bench.speed_error.results import ContenderFacts, Growth
from ibrpipe.config import Document
from ibrpipe.engine.machine import Machine


class Table2Row(Document):
    """One model, search and size."""

    model: str = Field(description="torus, globe or dragon")
    maps: int = Field(ge=1, description="Depth images over it")
    search: str = Field(description="Search of the renderer")
    size: int = Field(ge=1, description="Texels and pixels along a side")
    milliseconds: float = Field(ge=0, description="Median time of a frame with colour, depth and alpha")
    growth: float | None = Field(description="Factor of time per doubling, from the size before; null = the first")
    covered: float = Field(ge=0, le=1, description="Share of the pixels that show something")
    paper: float | None = Field(description="The paper's time, ms, on a 250 MHz R10000; null = it gives none")


class Skipped(Document):
    """A model that was not measured."""

    model: str = Field(description="Its name in the paper")
    reason: str = Field(description="Why, and what to do")


class Table2Model(Document):
    """Table 2 of schaufler1999, measured again."""

    schema_version: Literal[1] = 1
    machine: Machine = Field(description="Processor, threads, versions")
    rows: list[Table2Row] = Field(description="By model, search and size")
    skipped: list[Skipped] = Field(description="Models of the paper that are missing")
    seconds: float = Field(ge=0, description="Time of the whole run, s")


class GrowthModel(Document):
    """Time against size for each region of the epipole."""

    schema_version: Literal[2] = 2
    machine: Machine = Field(description="Processor, threads, versions")
    contenders: list[ContenderFacts] = Field(description="Who took part")
    growth: list[Growth] = Field(description="Time against size")
    most: float = Field(description="Greatest factor per doubling that the paper's claim of O(n^2) allows here")
    seconds: float = Field(ge=0, description="Time of the whole run, s")
