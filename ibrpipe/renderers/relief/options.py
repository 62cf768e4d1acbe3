"""Options of the `relief` renderer."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, Field, WithJsonSchema, model_validator

from ibrpipe.renderers.option_text import Expected
from ibrpipe.renderers.renderer import RendererOptions
from ibrpipe.types import Array

Search = Literal["exact", "linear-binary"]
Mapping = Literal["relief", "parallax", "bump", "plain"]


def _numbers(value: Any) -> Array:
    """Return finite real numbers as float64; text, truth values and ragged lists are none."""
    array = np.asarray(value)
    if array.dtype.kind not in "iuf" or not np.isfinite(array).all():
        raise ValueError("no finite numbers")
    return array.astype(np.float64, copy=False)


def _lamp(value: Any) -> tuple[float, ...] | None:
    if value is None:
        return None
    numbers = _numbers(value)
    if numbers.shape not in ((3,), (4,)):
        raise ValueError("neither three numbers nor four")
    return tuple(numbers.tolist())


def _share(value: Any) -> tuple[float, ...]:
    numbers = np.atleast_1d(_numbers(value))
    if numbers.shape not in ((1,), (3,)) or (numbers < 0).any():
        raise ValueError("neither one number nor three of at least 0")
    return tuple(numbers.tolist())


def _points(value: Any) -> Array | None:
    if value is None:
        return None
    points = np.ascontiguousarray(_numbers(value))
    if points.ndim != 2 or points.shape[1] != 3:
        raise ValueError("no points")
    return points


_LIGHT = Expected("a place x y z or a direction toward the light x y z 0, scene units, or none")
_POINTS = Expected("an array (V, 3) of finite numbers, as many as the mesh has, scene units, or none; in Python alone")
_POINTS_SCHEMA = {
    "anyOf": [
        {"type": "array", "items": {"type": "array", "items": {"type": "number"}, "minItems": 3, "maxItems": 3}},
        {"type": "null"},
    ]
}

#: of light, alike for red, green and blue, or for each
Share = Annotated[
    tuple[float, ...],
    BeforeValidator(_share),
    Field(min_length=1, max_length=3),
    Expected("one or three numbers of at least 0"),
]


class ReliefOptions(RendererOptions):
    """How height fields and relief-mapped meshes are searched, and how the latter are lit."""

    search: Search = Field(default="exact", description="How hits are found: no feature is missed, or as published")
    linear_steps: int = Field(default=32, ge=1, le=4096, description="Steps of the published search along the ray")
    binary_steps: int = Field(default=8, ge=0, le=64, description="Bisections of the published search after them")
    least_steps: int | None = Field(
        default=None,
        ge=1,
        le=4096,
        description="Steps of the published search along the normal; none: 10 on meshes, linear_steps on height fields",
    )
    level: Annotated[int, Field(ge=0, le=16)] | Literal["auto"] = Field(
        default=0,
        description="Level of the heights' mip maps, 2^level x 2^level texels averaged; auto: by size in the picture",
    )
    mapping: Mapping = Field(default="relief", description="Meshes: what is mapped; others than relief are baselines")
    model: Literal["flat", "shell"] = Field(
        default="flat", description="Meshes: polygons keep their silhouettes, as published, or the relief carves them"
    )
    light: Annotated[tuple[float, ...] | None, BeforeValidator(_lamp), _LIGHT] = Field(
        default=None, description="Meshes: where the lamp is; none: colours as they are"
    )
    ambient: Share = Field(default=(0.25,), description="Meshes: share of the light from everywhere")
    diffuse: Share = Field(default=(0.75,), description="Meshes: share of the lamp's diffuse light")
    specular: Share = Field(default=(0.15,), description="Meshes: share of the lamp's highlight")
    shininess: float = Field(default=20.0, ge=0, le=1e4, description="Meshes: exponent of the highlight")
    shadows: bool = Field(default=True, strict=False, description="Meshes: the relief shades itself")
    anisotropy: int = Field(
        default=8, ge=0, le=64, description="Meshes: probes of a pixel's footprint; 0: bilinear, no mip maps"
    )
    two_sided: bool = Field(
        default=False, strict=False, description="Meshes: polygons are seen from behind, without relief"
    )
    vertices: Annotated[Any, BeforeValidator(_points), WithJsonSchema(_POINTS_SCHEMA), _POINTS] = Field(
        default=None, description="Meshes: where the vertices are in this frame, for deforming meshes"
    )

    @model_validator(mode="after")
    def _shell_shows_relief(self) -> ReliefOptions:
        if self.model == "shell" and self.mapping != "relief":
            raise ValueError(f"model 'shell' shows a relief, not mapping {self.mapping!r}; choose model 'flat'")
        return self
