"""Settings of the depth maps."""

from __future__ import annotations

from typing import Literal

from pydantic import AliasChoices, Field

from ibrpipe.config import StageConfig


class DepthConfig(StageConfig):
    """Settings of the depth maps."""

    method: Literal["patchmatch", "sgbm"] = Field(
        "patchmatch",
        description="patchmatch = slanted planes over several photos; sgbm = rectified pairs, a fast draft",
    )
    max_size: int = Field(
        1600, ge=64, le=8192, description="Longest side of a depth map in pixels; larger photos are shrunk"
    )
    neighbours: int = Field(8, ge=1, le=16, description="Photos that a photo is matched with")
    keep: int = Field(3, ge=1, le=16, description="Best of the neighbours that a pixel's cost is made of")
    pairs: int = Field(6, ge=1, le=16, description="Neighbours that sgbm pairs a photo with")
    iterations: int = Field(5, ge=1, le=20, description="Sweeps at the coarsest size, where surfaces are found")
    coarsest: int = Field(300, ge=64, le=2048, description="Longest side of the coarsest size is at most this, pixels")
    sigma: float = Field(
        12.0, gt=0, le=255, description="Difference of grey (of 255) that halves a sample's weight, about"
    )
    consistency: float = Field(
        0.15,
        ge=0,
        le=2,
        description="Cost of a pixel of disagreement with a neighbour's depth (a correlation costs 0..2)",
    )
    min_agreeing: int = Field(
        2, ge=0, le=16, description="Neighbours whose depth must agree; as many as there are where there are fewer"
    )
    max_shift: float = Field(1.0, gt=0, le=8, description="Pixels by which agreeing depth may miss")
    max_depth_change: float = Field(0.01, gt=0, le=0.5, description="Relative difference that agreeing depth may have")
    max_normal_angle: float = Field(
        50.0,
        validation_alias=AliasChoices("max_normal_angle", "max_turn"),
        gt=0,
        le=180,
        description="Degrees by which agreeing normals may differ; of a mere pair of photos they are not compared",
    )
    min_segment: int = Field(20, ge=0, le=100_000, description="Smaller connected pieces are dropped, pixels")
