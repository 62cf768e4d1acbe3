"""Options of the `splat` renderer."""

from __future__ import annotations

from pydantic import Field

from ibrpipe.renderers.renderer import RendererOptions


class SplatOptions(RendererOptions):
    """How large samples are drawn."""

    footprint: float = Field(default=1.0, ge=0, le=16, description="Size of a sample, texels")
