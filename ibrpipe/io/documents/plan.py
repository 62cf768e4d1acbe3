"""What ``plan.json`` holds."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import ConfigDict, Field, SerializeAsAny, model_validator

from ibrpipe.config import Document, Vector


class PlannedComponent(Document):
    """View dependence that is to be modelled: its kind, and settings that belong to the kind."""

    model_config = ConfigDict(extra="allow")

    kind: str = Field(description="Kind of view dependence: spiral (settings k, residual_scale), or another")

    @property
    def settings(self) -> dict[str, Any]:
        """All but the kind."""
        return self.model_dump(exclude={"kind"})


class PlannedTexture(Document):
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
    coverage: bool = Field(False, description="Samples at rims hold which share of their texel they fill")
    components: list[SerializeAsAny[PlannedComponent]] = Field(
        description="View dependence that is modelled; empty = none"
    )

    @model_validator(mode="before")
    @classmethod
    def _earlier_form(cls, data: Any) -> Any:
        """Read `residuals`, `k` and `residual_scale` of earlier plans."""
        if not isinstance(data, dict) or "residuals" not in data:
            return data
        spiral = {"kind": "spiral", "k": data["k"], "residual_scale": data["residual_scale"]}
        kept = {key: value for key, value in data.items() if key not in ("residuals", "k", "residual_scale")}
        return {**kept, "components": [spiral] if data["residuals"] else []}


class Reason(Document):
    """A choice and why it was made."""

    what: str = Field(description="What was chosen")
    choice: Any = Field(description="The choice")
    reason: str = Field(description="Why, in words")
    measured: dict[str, Any] = Field(description="The figures behind it")


class Plan(Document):
    """``plan/plan.json``."""

    schema_version: Literal[1] = Field(alias="schema", description="Version of this layout")
    textures: list[PlannedTexture] = Field(description="What is to be modelled")
    reasons: list[Reason] = Field(description="One for each choice")
