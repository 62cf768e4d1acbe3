"""Options of the `splat` renderer."""

from __future__ import annotations

from pydantic import Field

from ibrpipe.renderers.renderer import RendererOptions


class SplatOptions(RendererOptions):
    """How large samples are drawn."""

    residuals: bool = Field(
        default=True, strict=False, description="Add view dependence where a texture has it, at the samples shown"
    )
    footprint: float = Field(default=1.0, ge=0, le=16, description="Size of a sample, texels")
