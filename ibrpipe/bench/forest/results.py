"""What the file of ``ibrpipe bench forest`` holds."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from ibrpipe.config import Document
from ibrpipe.engine.machine import Machine


class ForestRow(Document):
    """One forest from one camera. Milliseconds are CPU time over the number of threads unless they say wall time."""

    trees: int = Field(ge=1, description="Trees")
    view: str = Field(description="far, middle or near")
    ours_ms: float = Field(ge=0, description="A frame with colour and coverage, least of the repeats")
    ours_wall_ms: float = Field(ge=0, description="The same, wall time")
    ours_psnr: float | None = Field(
        description="Against the peer's picture of 256 samples a pixel, sRGB over a plain sky, dB; none with --alone"
    )
    peer: dict[str, tuple[float, float]] = Field(
        description="Embree with instances, by samples a pixel: milliseconds and PSNR; empty without the extra"
    )
    equal_ms: float | None = Field(
        description="The peer's time where its PSNR is ours: interpolated between its samples, logarithm of time"
    )
    ratio: float | None = Field(description="equal_ms / ours_ms")
    note: str = Field(description="Why a figure is missing; empty where none is")
    parts: int = Field(ge=0, description="Parts drawn from slices")
    slices: int = Field(ge=0, description="Slices drawn")
    triangles: int = Field(ge=0, description="Triangles drawn")


class FlightRow(Document):
    """A flight over one forest: change from frame to frame beyond the truth's, 8-bit codes of sRGB."""

    trees: int = Field(ge=1, description="Trees")
    frames: int = Field(ge=2, description="Frames, about a pixel of motion each")
    ours_rms: float = Field(ge=0, description="Root mean square over pixels of our change less the truth's")
    ours_block: float = Field(ge=0, description="The largest mean of it over a block of 16 x 16 pixels")
    kept_rms: float = Field(
        ge=0, description="Ours where every frame keeps the parts, resolutions and directions of the one before"
    )
    kept_block: float = Field(ge=0, description="The same, largest block")
    peer_rms: float | None = Field(description="Of Embree at 4 samples a pixel; none without the extra")
    peer_block: float | None = Field(description="Of Embree at 4 samples a pixel, largest block")


class TradeoffRow(Document):
    """One forest from one camera with one setting of what costs time or error."""

    varied: str = Field(description="pixel_error, directions or slab_texels; the others are as usual")
    value: float = Field(gt=0, description="Its value")
    view: str = Field(description="far, middle or near")
    ours_ms: float = Field(ge=0, description="A frame with colour and coverage, least of the repeats, CPU time")
    ours_wall_ms: float = Field(ge=0, description="The same, wall time")
    ours_psnr: float = Field(description="Against the peer's picture of 256 samples a pixel, dB")
    library_bytes: int = Field(ge=0, description="Bytes of the slices in memory")


class ForestModel(Document):
    """Forests of copies: speed at equal error."""

    schema_version: Literal[1] = 1
    machine: Machine = Field(description="Processor, threads, versions")
    width: int = Field(ge=1, description="Pixels a row")
    height: int = Field(ge=1, description="Rows")
    seed: int = Field(description="Of the trees and of where they stand")
    library_bytes: int = Field(ge=0, description="Bytes of the slices in memory, those of the last forest")
    prerender_seconds: float = Field(ge=0, description="Time to make them, wall time")
    rows: list[ForestRow] = Field(description="By number of trees and view")
    flights: list[FlightRow] = Field(default_factory=list, description="One a forest, where --flight is given")
    tradeoffs: list[TradeoffRow] = Field(default_factory=list, description="Of the first forest, with --tradeoff")
    seconds: float = Field(ge=0, description="Time of the whole run, s")
