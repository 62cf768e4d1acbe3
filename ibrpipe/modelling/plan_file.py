"""``plan.json``: what is to be modelled on every support rectangle, and the reason for every choice."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from pydantic import ConfigDict, Field, SerializeAsAny, ValidationError, model_validator

from ibrpipe.config import Document, Vector
from ibrpipe.errors import FormatError
from ibrpipe.modelling.rectangles import Rectangle

SCHEMA = 1


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


@dataclass(frozen=True, eq=False)
class TexturePlan:
    """What is to be modelled on one support rectangle."""

    rectangle: Rectangle
    max_angle_deg: float
    max_layers: int
    components: tuple[PlannedComponent, ...] = ()

    def component(self, kind: str) -> PlannedComponent | None:
        """Return what is planned of a kind of view dependence; None = nothing."""
        return next((component for component in self.components if component.kind == kind), None)


#: one entry of the plan's list of reasons, as `reason` makes it
Told = dict[str, Any]


def reason(what: str, choice: object, why: str, **measured: object) -> Told:
    """One entry of the plan's list of reasons."""
    return {"what": what, "choice": choice, "reason": why, "measured": measured}


def write_plan(plans: Sequence[TexturePlan], reasons: Sequence[Told], path: Path) -> None:
    """Write `plan.json`."""
    textures = [
        PlannedTexture(
            **plan.rectangle.as_json(),
            max_angle_deg=plan.max_angle_deg,
            max_layers=plan.max_layers,
            components=list(plan.components),
        )
        for plan in plans
    ]
    content = Plan(schema=SCHEMA, textures=textures, reasons=[Reason(**each) for each in reasons])
    text = json.dumps(content.model_dump(by_alias=True), indent=1, ensure_ascii=False)
    path.write_text(text, encoding="utf-8")


def read_plan(path: Path) -> list[TexturePlan]:
    """Read the textures of `plan.json`.

    Raises
    ------
    FormatError
        The file is missing, is no plan, or is of another schema version.
    """
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
        if data["schema"] != SCHEMA:
            raise FormatError(f"{path}: plan of schema {data['schema']}, expected {SCHEMA}; run the plan stage again")
        return [_plan_of(texture) for texture in Plan.model_validate(data).textures]
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join(str(part) for part in first["loc"])
        raise FormatError(f"{path}: not a plan ({where}: {first['msg']}); run the plan stage again") from error
    except (OSError, ValueError, KeyError, TypeError) as error:
        if isinstance(error, FormatError):
            raise
        raise FormatError(f"{path}: not a plan ({error}); run the plan stage again") from error


def _plan_of(texture: PlannedTexture) -> TexturePlan:
    rectangle = Rectangle.from_json(texture.model_dump())
    return TexturePlan(rectangle, texture.max_angle_deg, texture.max_layers, tuple(texture.components))
