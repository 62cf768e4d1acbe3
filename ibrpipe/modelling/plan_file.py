"""``plan.json``: what is to be modelled on every support rectangle, and the reason for every choice."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ibrpipe.errors import FormatError
from ibrpipe.modelling.rectangles import (
    Rectangle,
)

SCHEMA = 1


@dataclass(frozen=True, eq=False)
class TexturePlan:
    """What is to be modelled on one support rectangle."""

    rectangle: Rectangle
    max_angle_deg: float
    max_layers: int
    residuals: bool
    k: float
    residual_scale: float


Reason = dict[str, Any]


def reason(what: str, choice: object, why: str, **measured: object) -> Reason:
    """One entry of the plan's list of reasons."""
    return {"what": what, "choice": choice, "reason": why, "measured": measured}


def write_plan(plans: Sequence[TexturePlan], reasons: Sequence[Reason], path: Path) -> None:
    """Write `plan.json`."""
    textures = [
        {
            **plan.rectangle.as_json(),
            "max_angle_deg": plan.max_angle_deg,
            "max_layers": plan.max_layers,
            "residuals": plan.residuals,
            "k": plan.k,
            "residual_scale": plan.residual_scale,
        }
        for plan in plans
    ]
    content = {"schema": SCHEMA, "textures": textures, "reasons": list(reasons)}
    path.write_text(json.dumps(content, indent=1, ensure_ascii=False), encoding="utf-8")


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
        return [
            TexturePlan(
                Rectangle.from_json(t), t["max_angle_deg"], t["max_layers"], t["residuals"], t["k"], t["residual_scale"]
            )
            for t in data["textures"]
        ]
    except (OSError, ValueError, KeyError, TypeError) as error:
        if isinstance(error, FormatError):
            raise
        raise FormatError(f"{path}: not a plan ({error}); run the plan stage again") from error
