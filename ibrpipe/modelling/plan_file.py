"""``plan.json``: what is to be modelled on every support rectangle, and the reason for every choice."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from ibrpipe.errors import FormatError
from ibrpipe.io.documents.plan import Plan, PlannedComponent, PlannedTexture, Reason
from ibrpipe.io.untrusted.boundary import told
from ibrpipe.modelling.rectangles import Rectangle

SCHEMA = 1


@dataclass(frozen=True, eq=False)
class TexturePlan:
    """What is to be modelled on one support rectangle; with `coverage` how far rims fill their texels, too."""

    rectangle: Rectangle
    max_angle_deg: float
    max_layers: int
    components: tuple[PlannedComponent, ...] = ()
    coverage: bool = False

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
            coverage=plan.coverage,
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
    with told(path, "run the plan stage again", "not a plan"):
        try:
            data = json.loads(path.read_text(encoding="utf-8"))
            if data["schema"] != SCHEMA:
                raise FormatError(
                    f"{path}: plan of schema {data['schema']}, expected {SCHEMA}; run the plan stage again"
                )
            return [_plan_of(texture) for texture in Plan.model_validate(data).textures]
        except FileNotFoundError as error:
            raise FormatError(f"{path}: not a plan (there is no such file); run the plan stage again") from error
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            where = ".".join(str(part) for part in first["loc"])
            raise FormatError(f"{path}: not a plan ({where}: {first['msg']}); run the plan stage again") from error


def _plan_of(texture: PlannedTexture) -> TexturePlan:
    rectangle = Rectangle.from_json(texture.model_dump())
    components = tuple(texture.components)
    return TexturePlan(rectangle, texture.max_angle_deg, texture.max_layers, components, texture.coverage)
