"""Options of the `prewarp` renderer."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from ibrpipe.renderers.renderer import RendererOptions


class PrewarpOptions(RendererOptions):
    """How textures are warped and what is drawn of them."""

    method: Literal["two-pass", "pipelined"] = Field(
        default="two-pass", description="Rows, then columns, or both interspersed"
    )
    depth_bits: Literal[8, 32] = Field(
        default=32, description="Heights as 254 levels with look-up tables (8), or as floats (32)"
    )
    level: Annotated[int, Field(ge=0, le=16)] | Literal["auto"] = Field(
        default="auto", description="Level of the pyramid; auto: by the projected area"
    )
    max_step: float | None = Field(
        default=None,
        gt=0,
        allow_inf_nan=True,
        description="Height between neighbours above which they are parted, texels; none: as the source says, "
        "infinity: never",
    )
    fallback: Literal["auto", "never", "always"] = Field(
        default="auto", description="Exact search; auto: where the eye is in or very near a relief"
    )
    filter: Literal["point", "area"] = Field(
        default="point", description="Taken at pixel centres, or averaged over what a pixel covers"
    )
    quads: Literal["auto", "each"] = Field(
        default="auto",
        description="auto: textures on the faces of one box are merged into at most three quadrilaterals; "
        "each: each has its own",
    )
