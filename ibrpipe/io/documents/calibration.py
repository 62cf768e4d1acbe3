"""What ``calibration.json`` holds."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

from pydantic import ConfigDict, Field, model_validator

from ibrpipe.config import Document


class CalibratedLens(Document):
    """A lens that was found or adjusted."""

    model: str = Field(description="COLMAP's name of the camera model")
    params: list[float] = Field(description="Its parameters, pixels of the photo file")
    width: int = Field(ge=1, description="Pixels")
    height: int = Field(ge=1, description="Pixels")
    photos: int = Field(ge=1, description="Photos that were taken with it")
    start: Literal["given", "settings", "exif", "guess"] = Field(description="Where the search started from")
    start_params: list[float] = Field(description="Parameters at the start")
    angle_of_view_deg: float = Field(description="Horizontal angle of view without distortion, degrees")
    principal_point_deviation_px: float | None = Field(
        description="Standard deviation of the principal point, pixels; null = it was not adjusted"
    )


class CalibratedPhoto(Document):
    """A photo that was to be calibrated."""

    name: str = Field(description="Below images/; those of test/ begin with test/")
    registered: bool = Field(description="Its camera was found and is written")
    model: int | None = Field(description="Model that it is in; 0 is the one that is written; null = none")
    features: int = Field(ge=0, description="Features inside its mask")
    points: int = Field(ge=0, description="Points of the model that it sees")
    error_px: float | None = Field(description="Mean reprojection error, pixels; null = no point")
    best_partner: str | None = Field(description="Photo that it shares most matches with; null = none")
    best_matches: int = Field(ge=0, description="Those matches")


class CalibrationFinding(Document):
    """What to know, and what to do."""

    severity: Literal["warning", "note"] = Field(description="Warnings ask for other photos")
    file: str = Field(description="What it is about")
    text: str = Field(description="What was met")
    remedy: str = Field(description="What to do")


class PhotoSpacing(Document):
    """How far apart calibrated photos stand, told by what they share; medians over the photos."""

    nearest_deg: float = Field(description="Angle to the nearest partner at the points that both see, degrees")
    second_deg: float = Field(description="Angle to the second nearest")
    matched: float = Field(description="Share of a photo's features that match its best partner")
    widest: tuple[str, str] = Field(description="A photo and its nearest partner, where they are farthest apart")
    widest_deg: float = Field(description="Angle between these two")


class Spread(Document):
    """Two figures of many values."""

    mean: float = Field(description="Mean")
    median: float = Field(description="Median")


class Alignment(Document):
    """Where origin, axes and unit of the world come from; figures of the fit follow, which depend on the source."""

    model_config = ConfigDict(extra="allow")

    source: Literal["given", "markers", "positions", "gps", "own"] = Field(
        description="What the world was aligned to; own = nothing, it is from the photos alone"
    )
    how: str = Field(description="How, in words")


class Calibration(Document):
    """``calibrate/calibration.json``. All but the first three is left out where nothing was searched."""

    schema_version: Literal[1] = Field(alias="schema", description="Version of this layout")
    decision: Literal["given", "found", "refined"] = Field(
        description="given = the capture's own cameras are used as they are; found, refined = those of sparse/0"
    )
    reason: str = Field(description="Why, in words")
    registered: int | None = Field(None, description="Photos with a camera")
    photos_given: int | None = Field(None, description="Photos that were to be calibrated")
    points: int | None = Field(None, description="Sparse points")
    mean_track_length: float | None = Field(None, description="Photos that see a point, mean")
    reprojection_error_px: Spread | None = Field(None, description="Over all observations, pixels")
    units: str | None = Field(None, description="The unit of length, in words")
    alignment: Alignment | None = Field(None, description="Where the world comes from, and how well it fits")
    lenses: list[CalibratedLens] = Field(default=[], description="All lenses")
    photos: list[CalibratedPhoto] = Field(default=[], description="All photos, the left-out ones included")
    other_models: list[list[str]] = Field(default=[], description="Photos that hang together but not with the rest")
    spacing: PhotoSpacing | None = Field(None, description="How far apart the photos stand; null = too few in common")
    findings: list[CalibrationFinding] = Field(default=[], description="What to know, and what to do")
    peak_memory_bytes: int | None = Field(None, description="Largest resident memory of the child process")

    @model_validator(mode="before")
    @classmethod
    def _earlier_form(cls, data: Any) -> Any:
        """Read `world`, the alignment's source in earlier documents."""
        if not isinstance(data, dict) or "world" not in data:
            return data
        kept = {key: value for key, value in data.items() if key != "world"}
        return {**kept, "alignment": {"source": data["world"], **(data.get("alignment") or {})}}

    @classmethod
    def of_folder(cls, folder: Path | None) -> Calibration | None:
        """Read what the calibrate stage has written to `folder`; None where there is nothing.

        Raises
        ------
        FormatError
            ``calibration.json`` is damaged.
        """
        path = None if folder is None else folder / "calibration.json"
        if path is None or not path.is_file():
            return None
        return cls.read(path, "not what the calibrate stage writes", "calibrate")

    @property
    def in_own_world(self) -> bool:
        """Whether cameras were found, and nothing ties them to any other world."""
        return self.decision == "found" and self.alignment is not None and self.alignment.source == "own"
