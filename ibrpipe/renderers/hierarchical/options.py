"""Options of the `hierarchical` renderer."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from ibrpipe.renderers.renderer import RendererOptions

Mode = Literal["slices", "reproject", "polygons"]


class HierarchicalOptions(RendererOptions):
    """How fine parts are drawn, and of what."""

    pixel_error: float = Field(
        default=0.7, ge=0.1, le=16, description="Greatest width of a texel of a slice in the picture, pixels"
    )
    mode: Mode = Field(
        default="slices",
        description="Parts from prefiltered slices; from samples of six views, as published; or polygons only",
    )
    near: float = Field(
        default=0.0, ge=0, description="Nearest depth that is drawn, scene units; 0 = a millionth of the scene's radius"
    )
    shadows: bool = Field(default=False, description="Lights cast shadows")
    shadow_size: int = Field(
        default=2048, ge=64, le=8192, description="Texels along a side of what a light sees, for shadows"
    )
    occlusion: int = Field(
        default=0,
        ge=0,
        le=256,
        description="Directions from which the sky is looked for, to darken ambient light where it is hidden; 0 = none",
    )
