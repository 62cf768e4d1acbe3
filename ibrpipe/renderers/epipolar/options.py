"""Options of the `epipolar` renderer."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from ibrpipe.renderers.renderer import RendererOptions

Search = Literal["exact", "nearest", "linear"]


class EpipolarOptions(RendererOptions):
    """What an epipolar line meets."""

    residuals: bool = Field(default=True, strict=False, description="Add view dependence where a texture has it")
    search: Search = Field(
        default="exact",
        description="What a line meets: the exact surface, nearest samples as published, or interpolated ones",
    )
