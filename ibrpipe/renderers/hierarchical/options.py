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
