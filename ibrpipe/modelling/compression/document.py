"""What ``compression.json`` holds: what was chosen, why, and what it costs and saves."""

from __future__ import annotations

from pydantic import Field

from ibrpipe.config import Document
from ibrpipe.io.layer_pictures import Coding


class Trial(Document):
    """One way to code the asset, tried and measured."""

    layers: Coding = Field(description="Coding of the layers")
    component_quality: int | None = Field(None, description="Quality of view dependence; absent = kept as it was")
    weight_quality: int | None = Field(
        None, description="Quality of the weights of shared reflection; absent = kept as they were"
    )
    bytes: int = Field(ge=0, description="Size of the asset")
    psnr: float | None = Field(None, description="PSNR of the photos that are measured, dB")


class PartLevel(Document):
    """One level of one part: measured, or interpolated between what was."""

    level: dict[str, float | int] = Field(description="Settings; empty = exact")
    bytes: int = Field(ge=0, description="Bytes of the part, estimated")
    psnr_change: float = Field(description="What it alone changes of the PSNR of the measured photos, dB, estimated")


class Compression(Document):
    """``compression.json``."""

    why: str = Field(description="What was asked for, and whether it was kept")
    chosen: Trial = Field(description="How the asset is coded")
    joined_texels: int = Field(1, description="Texels along either edge of a texture that have become one")
    bytes_before: int = Field(ge=0, description="Size of the asset as it came")
    psnr_before: float | None = Field(None, description="PSNR of the photos before, dB")
    psnr_between: float | None = Field(
        None, description="PSNR that is expected between photos, dB, where the asset keeps photos"
    )
    views: list[str] = Field(description="Training photos that were measured")
    parts: dict[str, list[PartLevel]] = Field(
        default={}, description="What the levels of every part of the asset weigh and cost, from exact to coarse"
    )
    trials: list[Trial] = Field(description="All codings of the whole that were tried, in order")
