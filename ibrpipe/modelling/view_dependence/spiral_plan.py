"""What a plan says of a spiral: how dense its directions are, and how fine its images."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, ValidationError

from ibrpipe.errors import FormatError
from ibrpipe.io.documents.plan import PlannedComponent
from ibrpipe.modelling.plan_file import TexturePlan
from ibrpipe.types import SpiralResiduals

SPIRAL = SpiralResiduals.kind


class SpiralPlan(PlannedComponent):
    """The spiral of one texture."""

    kind: Literal["spiral"] = Field("spiral", description="Kind of view dependence")
    k: float = Field(gt=0, le=1, description="Spiral density: turns are 2 pi k apart")
    residual_scale: float = Field(
        gt=0, description="Texels of a residual image per texel of the layers, along each edge"
    )


def spiral_of(plan: TexturePlan) -> SpiralPlan:
    """Return what is planned of a texture's spiral.

    Raises
    ------
    FormatError
        No spiral is planned, or a setting is missing or out of its range.
    """
    found = plan.component(SPIRAL)
    if found is None:
        raise FormatError(f"the plan wants no spiral for texture {plan.rectangle.name}; run the plan stage again")
    try:
        return SpiralPlan.model_validate(found.model_dump())
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        raise FormatError(
            f"spiral of texture {plan.rectangle.name} in the plan: {first['loc'][0]}: {first['msg']}; "
            "run the plan stage again"
        ) from error
