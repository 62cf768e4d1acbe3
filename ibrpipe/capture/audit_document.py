"""What ``audit.json`` holds."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from ibrpipe.config import Document, Share, Vector


class Finding(Document):
    """One thing that the audit found."""

    severity: Literal["error", "warning", "note"] = Field(description="Errors stop the pipeline")
    kind: str = Field(description="Short fixed word, such as blurred")
    file: str = Field(description="What it is about")
    value: str = Field(description="What was met")
    expected: str = Field(description="What would be right")
    remedy: str = Field(description="What to do")


class AuditedPhoto(Document):
    """What was measured in one photo."""

    name: str = Field(description="Name of the view")
    held_out: bool = Field(description="For measuring only")
    sharpness: float = Field(description="Variance of the Laplacian over that of the coded luminance, in the mask")
    clipped: float = Field(description="Share of the mask's pixels with a channel at its top")
    black: float = Field(description="Share of the mask's pixels with all channels at the bottom")
    covered: Share = Field(description="Share of the picture that the mask keeps")
    seen: Share | None = Field(description="Share of the surface's area that the photo sees; null = no mesh")
    overlap: Share | None = Field(
        description="Mask against the mesh's outline, intersection over union; null = no mask or no mesh"
    )
    masked: bool = Field(description="A mask or alpha says which pixels count")


class AuditedSurface(Document):
    """How well the photos see the surface."""

    unseen: Share = Field(description="Share of the area that no photo sees")
    fewer_than_3: Share = Field(description="Share of the area that fewer than three photos see")
    median_photos: int = Field(description="Photos that see a point, median over the area")
    share_by_photos: dict[str, float] = Field(description="Share of the area by number of photos; 10+ = ten or more")
    thin_center: Vector | None = Field(description="Mean place of what fewer than three photos see; null = none")
    thin_facing: Vector | None = Field(description="Mean normal of what fewer than three photos see; null = none")
    samples: int = Field(description="Points that were tried")


class Audit(Document):
    """``ingest/audit.json``."""

    findings: list[Finding] = Field(description="Worst first")
    photos: list[AuditedPhoto] = Field(description="All photos that could be read")
    surface: AuditedSurface | None = Field(description="Coverage of the surface; null = no mesh")
