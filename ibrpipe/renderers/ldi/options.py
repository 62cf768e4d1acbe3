"""Options of the `ldi` renderer."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from ibrpipe.renderers.renderer import RendererOptions

Search = Literal["auto", "patches", "lines", "quadtree"]


class LdiOptions(RendererOptions):
    """How hits are found, and whether view dependence is added."""

    residuals: bool = Field(
        default=True, strict=False, description="Add the view-dependent residuals where a texture has them"
    )
    search: Search = Field(default="auto", description="How hits are found; all find the same")
