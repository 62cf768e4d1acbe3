"""What ``reliefs.json`` holds: relief textures, each one image of colour and quantised displacement."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from ibrpipe.config import Document, Vector


class ReliefFrame(Document):
    """Parallel frame: X = origin + u a + v b + height f; texel (0, 0)'s centre is at u = v = 0.5."""

    origin: Vector = Field(description="Outer corner of texel (0, 0), world")
    a: Vector = Field(description="Step of a column, world")
    b: Vector = Field(description="Step of a row, world")
    f: Vector = Field(description="Unit vector that heights count along, world")


class ReliefEntry(Document):
    """One relief texture."""

    name: str = Field(description="Such as the side of the object that it shows")
    file: str = Field(
        description="Image in the same folder: PNG of 8 or 16 bits with R, G, B in sRGB and the displacement's index "
        "in alpha, its greatest code transparent; or OpenEXR with linear R, G, B and heights Z, NaN = transparent"
    )
    frame: ReliefFrame
    low: float = Field(0.0, description="Height of index 0, scene units; of PNG alone")
    step: float = Field(1.0, gt=0, description="Height from one index to the next, scene units; of PNG alone")
    joined: bool = Field(True, description="All neighbours are one surface; false = parted above 4 texels of height")


class ReliefsFile(Document):
    """Relief textures of one object or place; they share one world."""

    schema_version: Literal[1] = 1
    generator: str = Field(description="What wrote them")
    made_from: str = Field("", description="Where they come from")
    reliefs: list[ReliefEntry] = Field(min_length=1, description="All relief textures")
