"""What ``speed_error.json`` holds."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from ibrpipe.config import Document
from ibrpipe.engine.machine import Machine


class ContenderFacts(Document):
    """One setting of a renderer, or a peer."""

    label: str = Field(description="Name in tables and plots, unique")
    renderer: str = Field(description="Name in the registry; 'peer' for others")
    what: str = Field(description="What it does, one sentence")
    options: dict[str, str | int | float | bool] = Field(description="Options that differ from the defaults")
    main: bool = Field(description="Takes part in the curves of growth")


class WorkFacts(Document):
    """One thing that is rendered."""

    name: str = Field(description="Name, unique")
    kind: Literal["height field", "object"] = Field(description="One relief texture, or six layered images of a mesh")
    n: int = Field(description="Texels along its longest side")
    texels: int = Field(description="Stored depths")
    views: list[str] = Field(description="Names of its views")


class Preparation(Document):
    """What preparing one thing for one contender costs."""

    work: str = Field(description="Name of what is rendered")
    contender: str = Field(description="Label")
    milliseconds: float = Field(ge=0, description="Time, once")
    bytes: int = Field(ge=0, description="Bytes held beyond the source")


class Timing(Document):
    """Time of a frame."""

    milliseconds: float = Field(ge=0, description="Median")
    low: float = Field(ge=0, description="Lower quartile, ms")
    high: float = Field(ge=0, description="Upper quartile, ms")
    fastest: float = Field(ge=0, description="Least, ms")
    frames: int = Field(ge=1, description="Timed frames")


class Score(Document):
    """One contender, one thing, one view: its speed and its error."""

    work: str = Field(description="Name of what is rendered")
    view: str = Field(description="Name of the view")
    contender: str = Field(description="Label")
    depth: Timing | None = Field(description="Time of depth alone; null = it draws none")
    both: Timing | None = Field(description="Time of colour and depth; for peers without colour that of depth")
    wrong: float = Field(
        ge=0, le=1, description="Share of pixels lost, extra or over a texel astray, of its own surface"
    )
    rmse: float = Field(ge=0, description="Root mean square distance along the ray of right hits, texels")
    p99: float = Field(ge=0, description="99th percentile of the distance along the ray over all hits, texels")
    worst: float = Field(ge=0, description="Largest distance along the ray over all hits, texels")
    clipped: float = Field(ge=0, le=1, description="Mean over pixels of the distance along the ray, 1 at most, texels")
    codes: float | None = Field(
        description="Root mean square error of colour against the supersampled truth, 8-bit sRGB"
    )
    meant_wrong: float = Field(ge=0, le=1, description="Share of wrong pixels against the surface that was sampled")
    meant_rmse: float = Field(ge=0, description="Root mean square distance of right hits from it, texels")


class Growth(Document):
    """Times of one contender over sizes."""

    series: str = Field(description="'texels grow', 'both grow', or the region of the epipole")
    contender: str = Field(description="Label")
    sizes: list[int] = Field(description="Texels along a side; where both grow, also pixels")
    milliseconds: list[float] = Field(description="Fastest frame with depth alone")
    slope: float | None = Field(description="Exponent p of time ~ n^p; 2 = linear in the number of texels")
    doublings: list[float] = Field(description="Factor of time from each size to the next")
    spread: list[float] = Field(
        [],
        description="By size: range of several rounds' fastest frames but the slowest, over the least; empty = one",
    )


class Choice(Document):
    """Who is fastest within a demand on the error."""

    need: str = Field(description="The demand in words")
    work: str = Field(description="Name of what is rendered")
    view: str = Field(description="Name of the view")
    winner: str | None = Field(description="Label of the fastest that meets it; null = nobody")
    milliseconds: float | None = Field(description="Its median time, ms")
    second: str | None = Field(description="Label of the next")
    ratio: float | None = Field(description="Time of the next over that of the winner")


class SpeedErrorModel(Document):
    """Speed against error of all contenders in one interleaved run."""

    schema_version: Literal[2] = 2
    machine: Machine = Field(description="Processor, threads, versions")
    preset: Literal["quick", "full"] = Field(description="Sizes and repeats")
    width: int = Field(description="Width of the pictures")
    height: int = Field(description="Height of the pictures")
    contenders: list[ContenderFacts] = Field(description="Who took part")
    works: list[WorkFacts] = Field(description="What was rendered")
    preparations: list[Preparation] = Field(description="Cost of preparing")
    scores: list[Score] = Field(description="Speed and error, by thing, view and contender")
    growth: list[Growth] = Field(description="Time against size")
    choices: list[Choice] = Field(description="Who is fastest within which error, drawn from the scores")
    spread: float | None = Field(description="Median of (upper - lower quartile) / median over all timings")
    seconds: float = Field(ge=0, description="Time of the whole run, s")
