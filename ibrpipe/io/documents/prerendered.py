"""What ``prerendered.json`` holds: slices of a scene's parts."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from ibrpipe.config import Document, Share


class FormFigures(Document):
    """What one form of a part loses against its polygons where a texel is a pixel wide, in test directions."""

    psnr: float | None = Field(default=None, description="Of pictures before white, dB; null = it shows nothing")
    coverage: float | None = Field(
        default=None, ge=0, description="Mean difference of coverage, against what the part covers"
    )


class PartSlices(Document):
    """One part."""

    name: str = Field(description="Of the part; NAME/own = the own meshes of a part that also has copies of others")
    center: list[float] = Field(min_length=3, max_length=3, description="Centre of its sphere, the part's units")
    radius: float = Field(gt=0, description="Radius of its sphere")
    overlap: float = Field(ge=0, le=64, description="Texels by which a slab goes on into the one behind it")
    leak: Share | None = Field(
        default=None, description="Mean of what is seen through what polygons cover wholly, in test directions"
    )
    other_leak: Share | None = Field(default=None, description="The same with the overlap that was not chosen")
    samples: int = Field(default=0, ge=0, description="Samples of its six views; 0 where copies make it")
    slices: FormFigures | None = Field(default=None, description="What its slices lose; absent = not measured")
    views: FormFigures | None = Field(default=None, description="What its six views lose; absent = not measured")


class PrerenderedFile(Document):
    """Both forms of a scene's parts.

    Texels of prefiltered slices are in ``texels.exr``, row by row, in the order of ``slabs.npz``; samples of the six
    views of max1999 in ``views.exr``, part by part.
    """

    schema_version: Literal[3] = 3
    parts: list[PartSlices] = Field(description="In the order of their stacks")
    resolutions: list[Annotated[int, Field(ge=1, le=4096)]] = Field(
        min_length=1, description="Texels across a part's sphere, ascending"
    )
    directions: int = Field(ge=1, le=65536, description="Views over the sphere; 6 = those of max1999, else a spiral")
    scale: float = Field(gt=0, description="Albedo of code 255")
    texels: int = Field(ge=0, description="Texels in the picture; what is left of its last row is 0")
    slabs: int = Field(ge=0, description="Slabs in slabs.npz")
    seconds: float = Field(ge=0, description="Time to make the slices, s")
    file_bytes: int = Field(ge=0, description="Bytes of the picture and the slabs' file")
    views_seconds: float = Field(default=0.0, ge=0, description="Time to make the six views, s")
    views_bytes: int = Field(default=0, ge=0, description="Bytes of the six views' file; 0 = there is none")

    @model_validator(mode="after")
    def _sound(self) -> Self:
        if any(low >= high for low, high in zip(self.resolutions, self.resolutions[1:])):
            raise ValueError(f"resolutions {self.resolutions} do not ascend")
        names = [part.name for part in self.parts]
        if len(set(names)) < len(names):
            raise ValueError("two parts have one name")
        return self
