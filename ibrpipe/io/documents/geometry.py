"""What ``geometry.json`` holds."""

from __future__ import annotations

from typing import Literal

from pydantic import AliasChoices, Field

from ibrpipe.config import Document, Number, Share
from ibrpipe.io.documents.audit import AuditedSurface


class DepthMapFacts(Document):
    """Where the depth of a view comes from."""

    view: str = Field(description="Name of the view")
    neighbours: list[str] = Field(description="Views that it was matched with")
    angles: list[float] = Field(
        default=[], description="Angle to each of them at what both see, median, degrees; empty = depth was given"
    )
    seconds: float = Field(ge=0, description="What it took; 0 = taken over from an earlier run, or given")


class Geometry(Document):
    """``geometry/geometry.json``."""

    schema_version: Literal[1] = Field(alias="schema", description="Version of this layout")
    decision: Literal["given", "depth", "photos"] = Field(
        description="given = the capture's own mesh, depth = from depth maps of the capture, photos = from photos"
    )
    reason: str = Field(description="Why this mesh or this method, in words")
    depth_from: str | None = Field(None, description="Where depth comes from; empty = only outlines were used")
    depth_maps: list[DepthMapFacts] | None = Field(None, description="The depth maps, a view each")
    spacing_deg: dict[str, Number] | None = Field(
        None,
        description="Median angle from a photo to the nearest, second, fourth and farthest neighbour of those that its "
        "depth came from, degrees",
    )
    warnings: list[str] | None = Field(None, description="What to know, and what to shoot")
    method: Literal["volume", "poisson", "hull"] | None = Field(None, description="How depth became a surface")
    filled_by_hull: bool | None = Field(
        None,
        validation_alias=AliasChoices("filled_by_hull", "filled_by_outlines"),
        description="The masks' outlines stand where no depth is",
    )
    measured: dict[str, Number] | None = Field(None, description="The figures behind the choice of the method")
    points: int | None = Field(None, description="Points that depth maps agree on")
    voxel: float | None = Field(None, description="Size of a voxel, scene units")
    voxel_wanted: float | None = Field(
        None, description="Size of a voxel that the settings ask for; it is smaller where memory did not suffice"
    )
    parts_dropped: int | None = Field(None, description="Connected parts that were too small to keep")
    moved_to_outlines: dict[str, Number] | None = Field(
        None,
        description="Of the vertices moved to the masks' outlines: share; inferred = share moved more than a voxel, "
        "which stand where masks put them rather than depth; mean and most of all moves, voxels",
    )
    two_sided: dict[str, Number | str] | None = Field(
        None,
        description="The second side of thin walls: share of the area that has one; share of the pixels that show "
        "backs in place; thickness (median, scene units); reason",
    )
    vertices: int = Field(ge=0, description="Vertices of mesh.ply")
    faces: int = Field(ge=0, description="Faces of mesh.ply")
    area: float | None = Field(None, description="Of the surface, square scene units")
    unseen_share: Share | None = Field(None, description="Share of the area that no depth map shows")
    looked_through_share: Share | None = Field(
        None, description="Share of the area that is kept to close the surface although depth maps look through it"
    )
    boundary_loops: int | None = Field(None, description="Open borders; 0 = closed")
    boundary_length: float | None = Field(None, description="Length of all open borders, scene units")
    crowded_edges: int | None = Field(None, description="Edges with more than two faces")
    closed: bool | None = Field(None, description="No open border")
    confidence: dict[str, Number] | None = Field(None, description="Of the vertices: mean, and the least sure tenth")
    observations_median: int | None = Field(None, description="Depth maps that show a vertex, median")
    seconds: dict[str, Number] | None = Field(None, description="Of depth, fusion and surface")
    coverage: AuditedSurface | None = Field(None, description="How well the photos see the surface")
