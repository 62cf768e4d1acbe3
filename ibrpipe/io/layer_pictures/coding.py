"""How finely the compact form of layers is coded."""

from __future__ import annotations

from typing import Any, Literal, Self

from pydantic import Field, SerializerFunctionWrapHandler, model_serializer, model_validator

from ibrpipe.config import Document


class Coding(Document):
    """What is kept of colours, depths and normals; None = every bit."""

    color_quality: int | None = Field(
        None, ge=1, le=100, description="Quality of the colours, AVIF to 96, above it JPEG XL; absent = exact"
    )
    depth_step: float | None = Field(
        None, gt=0, le=16, description="Step of the depths, shares of a texel's pitch; absent = exact"
    )
    normal_bits: int | None = Field(
        None, ge=3, le=16, description="Bits of either octahedral coordinate of the normals; absent = exact"
    )

    normal_quality: int | None = Field(
        None,
        ge=1,
        le=100,
        description="AVIF quality of how normals differ from those had from depth; absent = not so",
    )
    normal_tolerance: float | None = Field(
        None,
        gt=0,
        le=180,
        description="Normals are had from depth where that is right within so many degrees; absent = nowhere",
    )
    half_chroma: Literal[True] | None = Field(
        None, description="Chroma of the colours at half the resolution, AVIF only; absent = full"
    )
    codewords: int | None = Field(
        None,
        ge=2,
        le=4096,
        description="Words for blocks of 2 x 2 colours (gong-yang) instead of a quality",
    )

    @model_validator(mode="after")
    def _rest_is_coded(self) -> Self:
        if self.normal_tolerance is not None and self.normal_bits is None:
            raise ValueError("normal_tolerance needs normal_bits for the normals that depth does not give")
        if self.normal_quality is not None and self.normal_bits is not None:
            raise ValueError("normal_quality and normal_bits are two ways to code normals; give one")
        return self

    @property
    def lossless(self) -> bool:
        """Whether every bit is kept."""
        return self == LOSSLESS

    @model_serializer(mode="wrap")
    def _said(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Leave out what is exact."""
        return {key: value for key, value in handler(self).items() if value is not None}


LOSSLESS = Coding()
