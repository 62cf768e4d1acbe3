"""What ``asset.json`` says of the error that is to be expected of a texture, as a whole and tile by tile."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, model_validator

from ibrpipe.config import Document, Share


class TileErrors(Document):
    """Figures of every tile, row by row; null = no photo shows it, or nothing lies there."""

    color_rms: list[float | None] = Field(description="Root of the mean square of colour errors, 8-bit codes")
    depth_rms: list[float | None] | None = Field(
        None, description="The same of depth along camera z, scene units; absent = no view has true depth"
    )
    coverage: list[float | None] | None = Field(
        None, description="Share of the samples that photos have seen; absent = all of them"
    )
    confidence: list[float | None] = Field(
        description="0 to 1: mean over the samples of n / (n + 2), n the photos behind one; 1 where that is not known"
    )


class TextureErrors(Document):
    """Expected errors of one texture."""

    measured_on: Literal["held-out views", "training photos"] = Field(
        description="Views that were not used for the asset; training photos, which err less, where none is held out"
    )
    pixels: int = Field(ge=0, description="Pixels of these views, inside the masks, that show the texture")
    color_rms: float | None = Field(None, description="As in tiles; absent = no pixel shows the texture")
    depth_rms: float | None = Field(None, description="As in tiles")
    coverage: Share | None = Field(None, description="As in tiles")
    confidence: Share | None = Field(None, description="As in tiles")
    tile: int = Field(ge=1, description="Texels along an edge of a tile")
    rows: int = Field(ge=0, description="Tiles from top to bottom")
    columns: int = Field(ge=0, description="Tiles from left to right")
    tiles: TileErrors = Field(description="Tile by tile")

    @model_validator(mode="after")
    def _complete(self) -> TextureErrors:
        lists = [self.tiles.color_rms, self.tiles.coverage, self.tiles.confidence, self.tiles.depth_rms]
        if any(values is not None and len(values) != self.rows * self.columns for values in lists):
            raise ValueError(f"tiles must hold {self.rows} x {self.columns} figures of each kind")
        return self
