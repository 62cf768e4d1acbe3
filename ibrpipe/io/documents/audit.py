"""What ``audit.json`` holds."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import ConfigDict, Field
from pydantic.dataclasses import dataclass

from ibrpipe.config import Document, Rounded, RoundedShare

Severity = Literal["error", "warning", "note"]
RoundedVector = Annotated[list[Rounded], Field(min_length=3, max_length=3)]


@dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class Finding:
    """One thing that the audit found."""

    severity: Severity = Field(description="Errors stop the pipeline")
    kind: str = Field(description="Short fixed word, such as blurred")
    file: str = Field(description="What it is about")
    value: str = Field(description="What was met")
    expected: str = Field(description="What would be right")
    remedy: str = Field(description="What to do")

    @property
    def line(self) -> str:
        """The finding as one sentence."""
        return f"{self.file}: {self.value}; expected {self.expected}: {self.remedy}"


class AuditedPhoto(Document):
    """What was measured in one photo."""

    name: str = Field(description="Name of the view")
    held_out: bool = Field(description="For measuring only")
    sharpness: Rounded = Field(description="Variance of the Laplacian over that of the coded luminance, in the mask")
    clipped: Rounded = Field(description="Share of the mask's pixels with a channel at its top")
    black: Rounded = Field(description="Share of the mask's pixels with all channels at the bottom")
    covered: RoundedShare = Field(description="Share of the picture that the mask keeps")
    seen: RoundedShare | None = Field(description="Share of the surface's area that the photo sees; null = no mesh")
    overlap: RoundedShare | None = Field(
        description="Mask against the mesh's outline, intersection over union; null = no mask or no mesh"
    )
    masked: bool = Field(description="A mask or alpha says which pixels count")


class AuditedSurface(Document):
    """How well the photos see the surface."""

    unseen: RoundedShare = Field(description="Share of the area that no photo sees")
    fewer_than_3: RoundedShare = Field(description="Share of the area that fewer than three photos see")
    median_photos: int = Field(description="Photos that see a point, median over the area")
    share_by_photos: dict[str, Rounded] = Field(description="Share of the area by number of photos; 10+ = ten or more")
    thin_center: RoundedVector | None = Field(description="Mean place of what fewer than three photos see; null = none")
    thin_facing: RoundedVector | None = Field(
        description="Mean normal of what fewer than three photos see; null = none"
    )
    samples: int = Field(description="Points that were tried")


class Audit(Document):
    """``ingest/audit.json``."""

    findings: list[Finding] = Field(description="Worst first")
    photos: list[AuditedPhoto] = Field(description="All photos that could be read")
    surface: AuditedSurface | None = Field(description="Coverage of the surface; null = no mesh")

    @property
    def errors(self) -> list[Finding]:
        """Findings that stop the pipeline."""
        return [finding for finding in self.findings if finding.severity == "error"]
