"""``residuals.json``: which components were fitted, where their files are, and their figures."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import ConfigDict, Field

from ibrpipe.config import Document, Share
from ibrpipe.io.components import Component
from ibrpipe.io.residuals import NAME as ARCHIVE

NAME = "residuals.json"


class ResidualsFigures(Document):
    """Figures of one texture's residuals on spiral directions."""

    model_config = ConfigDict(extra="ignore")

    name: str = Field(description="Name of the texture")
    directions: int = Field(ge=0, description="Residual images, one per direction of the spiral")
    texels: int = Field(ge=0, description="Texels of all images")
    valid_share: Share = Field(description="Share of the texels that hold a residual")
    clamped_texels: int = Field(ge=0, description="Valid texels with a channel outside the range of the code")
    clamped_share: Share = Field(description="Those over the valid ones")
    zero: int = Field(description="Code of a residual of nothing")
    encoding: Literal["8bit", "half"] = Field(description="How texels are stored")
    texture: int = Field(ge=0, description="Index of the texture in the plan")
    bytes: int = Field(ge=0, description="Size of the texture's residual file")
    component: Component = Field(
        default_factory=lambda data: Component(kind="spiral", file=f"texture_{data.get('texture', 0):02d}/{ARCHIVE}"),
        description="What the asset will say of it; files from this folder on",
    )


class ComponentFigures(Document):
    """Figures of one texture's view dependence of another kind."""

    model_config = ConfigDict(extra="allow")

    name: str = Field(description="Name of the texture")
    texture: int = Field(ge=0, description="Index of the texture in the plan")
    bytes: int = Field(ge=0, description="Size of its files")
    component: Component = Field(description="What the asset will say of it; files from this folder on")


Figures = ResidualsFigures | ComponentFigures


class Residuals(Document):
    """``residuals/residuals.json``."""

    textures: list[Annotated[Figures, Field(union_mode="left_to_right")]] = Field(
        description="The textures that have view dependence, once for each of its kinds"
    )
    training_psnr: list[float] = Field(
        default=[],
        description="PSNR of the training photos on exact geometry, dB: before every round of refinement, and at last",
    )
    shared: list[Component] = Field(default=[], description="What the components of a kind share")

    def of_texture(self, which: int) -> list[Figures]:
        """Return the figures of one texture's view dependence, in the order in which it is added."""
        return [figures for figures in self.textures if figures.texture == which]


def measured(figures: Figures) -> dict[str, Any]:
    """Return the figures without what says where files are."""
    return figures.model_dump(exclude={"component"})


def read_document(folder: Path) -> Residuals:
    """Read `residuals.json` of a folder that the residuals stage has filled.

    Raises
    ------
    MissingFileError, FormatError
        It is missing, or damaged.
    """
    return Residuals.read(folder / NAME, "damaged", "residuals")
