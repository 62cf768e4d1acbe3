"""Settings of fusion and surface."""

from __future__ import annotations

from typing import Literal

from pydantic import AliasChoices, Field

from ibrpipe.config import StageConfig

Method = Literal["volume", "poisson", "hull"]


class SurfaceConfig(StageConfig):
    """How depth maps become a surface."""

    method: Literal["auto", "volume", "poisson", "hull"] = Field(
        "auto",
        description="volume = averaged signed distances, poisson = screened Poisson on the points, hull = the outlines "
        "alone; auto = chosen by what the maps and masks hold",
    )
    hull_completion: Literal["auto", "always", "never"] = Field(
        "auto",
        validation_alias=AliasChoices("hull_completion", "fill"),
        description="Close what no depth shows by the outlines; auto = where masks show a whole object from around",
    )
    silhouette_fit: bool = Field(
        True,
        validation_alias=AliasChoices("silhouette_fit", "fit_rims"),
        description="Move the surface's rims to the masks' outlines, where at least three photos show them near",
    )
    two_sided: Literal["auto", "never", "always"] = Field(
        "auto",
        description="Give a thin wall a second side with colours of its own; auto = where depth maps see the backs of "
        "its faces in place, always = everywhere",
    )
    votes: int = Field(2, ge=1, le=20, description="Depth maps that must agree on a pixel, its own included")
    disparity: float = Field(1.0, gt=0, le=20, description="Most disparity between maps that agree, pixels")
    depth_difference: float = Field(0.01, gt=0, le=0.5, description="Most difference of depths that agree, share")
    normal_angle: float = Field(35.0, gt=0, le=180, description="Most angle between agreeing normals, degrees")
    voxel_pixels: float = Field(1.25, gt=0, le=20, description="Size of a voxel in photo pixels on the surface")
    truncation: float = Field(4.0, ge=1, le=32, description="Distances count up to this many voxels from a surface")
    carve: float = Field(0.2, ge=0, le=1, description="Weight of a ray's empty part against its surface")
    triangle_pixels: float = Field(
        2.0, ge=0, le=100, description="Mean edge of the triangles in photo pixels on the surface; 0 = not simplified"
    )
    least_part: float = Field(
        0.02, ge=0, le=1, description="Connected parts smaller than this share of the largest one's area are dropped"
    )
    depth_share: float = Field(
        0.15, ge=0, le=1, description="auto takes the hull when fewer of the masks' pixels than this have agreed depth"
    )
