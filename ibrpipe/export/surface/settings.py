"""Settings of the exporters of surfaces."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from ibrpipe.config import StageConfig


class SurfaceOptions(StageConfig):
    """How an asset becomes one mesh with one atlas."""

    tolerance: float = Field(
        2.0, ge=0, le=16, description="Triangles are joined while the surface moves by less than about this, texels"
    )


class GltfOptions(SurfaceOptions):
    """How an asset becomes glTF."""

    material: Literal["unlit", "lit"] = Field(
        "unlit",
        description="unlit = colours as photographed, whatever the light; lit = the viewer's lights, normal map",
    )
    texture: Literal["png", "webp"] = Field(
        "png", description="Pictures: png = nothing is lost; webp = fewer bytes, not known to every program"
    )
    quality: int = Field(95, ge=1, le=100, description="Quality of webp pictures; 100 = nothing is lost")
    measure: bool = Field(True, description="Draw the written file and tell how far it is from asset and photos")


class PlyOptions(StageConfig):
    """How an asset becomes PLY."""

    content: Literal["mesh", "points"] = Field("mesh", description="Triangles with a colour a vertex, or samples alone")
