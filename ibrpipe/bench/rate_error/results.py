"""What ``rate_error.json`` holds."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from ibrpipe.config import Document
from ibrpipe.engine.machine import Machine


class RatePoint(Document):
    """One coding of one asset, or the photos themselves."""

    series: str = Field(description="whole, diffuse, paper, raw, or lumigraph")
    label: str = Field(description="The coding in words")
    bytes: int = Field(ge=0, description="Size of the asset folder; of the lumigraph that of the photos")
    share: float = Field(ge=0, description="Bytes over those of the photos")
    psnr: float | None = Field(description="dB in the masks of the held-out views, mean")
    ssim: float | None = Field(description="Structural similarity, mean")
    flip: float | None = Field(description="LDR-FLIP, mean")
    decode_seconds: float | None = Field(None, description="Time to read the asset; absent = not an asset")
    ms_per_frame: float | None = Field(None, description="Fastest frame at the timed width, milliseconds")


class RateCurve(Document):
    """One run."""

    run: str = Field(description="Name of the run folder")
    photo_bytes: int = Field(ge=0, description="Size of the training photos")
    views: list[str] = Field(description="Held-out views that were measured")
    width: int = Field(ge=1, description="Width of timed frames, pixels")
    points: list[RatePoint] = Field(description="By series, from fine to coarse")


class RateErrorModel(Document):
    """Bytes against error."""

    schema_version: Literal[1] = 1
    machine: Machine = Field(description="Processor, threads, versions")
    curves: list[RateCurve] = Field(description="One a run")
    seconds: float = Field(ge=0, description="Time of the whole bench, s")
