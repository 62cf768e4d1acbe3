"""What the JSON files of a run hold, as models: the source of their schemas and a check on those who write them."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field

Vector = Annotated[list[float], Field(min_length=3, max_length=3)]
Matrix33 = Annotated[list[Vector], Field(min_length=3, max_length=3)]
Matrix34 = Annotated[list[Annotated[list[float], Field(min_length=4, max_length=4)]], Field(min_length=3, max_length=3)]
Share = Annotated[float, Field(ge=0, le=1)]


class _Document(BaseModel):
    model_config = ConfigDict(extra="forbid")


class PlannedTexture(_Document):
    """A support rectangle and what is modelled on it."""

    name: str = Field(description="Name of the texture")
    projection: Literal["parallel", "perspective"] = Field(description="How rays leave the rectangle")
    origin: Vector = Field(description="World position of the corner where u = v = 0")
    u: Vector = Field(description="Whole edge along the columns, world")
    v: Vector = Field(description="Whole edge along the rows, world; u x v points into the scene")
    center: Vector | None = Field(description="Centre of a perspective projection, world; null = parallel")
    width: int = Field(ge=1, description="Texels along u")
    height: int = Field(ge=1, description="Texels along v")
    max_angle_deg: float = Field(description="Surfaces tilted further go to a texture that faces them better, degrees")
    max_layers: int = Field(ge=1, description="Layers at the most")
    residuals: bool = Field(description="Whether view dependence is modelled")
    k: float = Field(description="Spiral density: turns are 2 pi k apart")
    residual_scale: float = Field(description="Texels of a residual image per texel of the layers, along each edge")


class Reason(_Document):
    """A choice and why it was made."""

    what: str = Field(description="What was chosen")
    choice: Any = Field(description="The choice")
    reason: str = Field(description="Why, in words")
    measured: dict[str, Any] = Field(description="The figures behind it")


class Plan(_Document):
    """``plan/plan.json``."""

    schema_version: Literal[1] = Field(alias="schema", description="Version of this layout")
    textures: list[PlannedTexture] = Field(description="What is to be modelled")
    reasons: list[Reason] = Field(description="One for each choice")


class ResidualsFigures(BaseModel):
    """Figures of one texture's residuals."""

    name: str = Field(description="Name of the texture")
    texture: int = Field(ge=0, description="Index of the texture in the plan")
    directions: int = Field(ge=0, description="Residual images, one per direction of the spiral")
    texels: int = Field(ge=0, description="Texels of all images")
    valid_share: Share = Field(description="Share of the texels that hold a residual")
    clamped_texels: int = Field(ge=0, description="Valid texels with a channel outside the range of the code")
    clamped_share: Share = Field(description="Those over the valid ones")
    zero: int = Field(description="Code of a residual of nothing")
    encoding: Literal["8bit", "half"] = Field(description="How texels are stored")
    bytes: int = Field(ge=0, description="Size of the texture's residual file")


class Residuals(_Document):
    """``residuals/residuals.json``."""

    textures: list[ResidualsFigures] = Field(description="The textures that have residuals")
    training_psnr: list[float] = Field(
        default=[],
        description="PSNR of the training photos on exact geometry, dB: before every round of refinement, and at last",
    )
