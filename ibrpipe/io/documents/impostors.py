"""What ``impostors.json`` holds: the views of an atlas of impostors, and how its pictures are to be read."""

from __future__ import annotations

from pydantic import Field

from ibrpipe.config import Document, Vector


class ImpostorView(Document):
    """One cell of the atlas."""

    column: int = Field(ge=0, description="Of the cell, from the left")
    row: int = Field(ge=0, description="Of the cell, from the top")
    direction: Vector = Field(description="Unit, from the part towards the viewer")
    right: Vector = Field(description="Unit, along columns of texels")
    up: Vector = Field(description="Unit, against rows of texels")


class Impostors(Document):
    """``impostors.json``: orthographic pictures of one part from directions on an octahedron, and from six sides."""

    part: str = Field(description="Name of the part")
    center: Vector = Field(description="Middle of every picture, the part's coordinates")
    radius: float = Field(
        gt=0, description="Half the width of a cell, and how far depth 0 lies before the middle; part's units"
    )
    texels: int = Field(ge=1, description="Along either side of a cell")
    grid: int = Field(ge=2, description="Cells along either side of the octahedral map; six sides stand below it")
    albedo: str = Field(description="PNG, sRGB; alpha = share of the texel that is covered")
    normal: str = Field(description="OpenEXR, R G B: unit normal, part's coordinates, towards the viewer; 0 = nothing")
    depth: str = Field(description="OpenEXR, Z: distance from the plane of depth 0 in the part's units; inf = nothing")
    normal_png: str | None = Field(None, description="PNG of the same, 8 bits: 0..255 is -1..1; grey = nothing")
    depth_png: str | None = Field(
        None,
        description="PNG of the same: 256 red + green = 65535 at twice the radius; blue 255 = covered, 0 = nothing",
    )
    views: list[ImpostorView] = Field(description="Octahedral cells row by row, then +x, -x, +y, -y, +z, -z")
