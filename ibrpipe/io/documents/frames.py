"""What ``frames.json`` holds: rendered pictures, their cameras and what they took."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import Field

from ibrpipe.config import Document, Matrix33, Matrix34


class RenderedFrame(Document):
    """One picture of one renderer."""

    view: str = Field(description="Name of the view along the path")
    renderer: str = Field(description="Name of the renderer")
    file: str = Field(description="OpenEXR file: linear R G B, A, Z = depth along camera z, as far as asked for")
    png: str | None = Field(None, description="8-bit sRGB picture; absent without colour")
    ms: float = Field(ge=0, description="Milliseconds of the frame, median over the repeats")
    first: str | None = Field(None, description="8-bit sRGB picture of the first frame of several; absent = one only")
    first_ms: float | None = Field(None, ge=0, description="Milliseconds to the first frame, median over the repeats")
    width: int = Field(ge=1, description="Pixels")
    height: int = Field(ge=1, description="Pixels")
    K: Matrix33 = Field(description="Calibration, pixels")
    cam_from_world: Matrix34 = Field(description="Pose [R t], world to camera, OpenCV axes, scene units")
    stats: dict[str, Any] = Field(description="Figures that the renderer tells")


class Frames(Document):
    """``render/frames.json``."""

    path: str | None = Field(None, description="Camera path as the settings name it; absent = from ibrpipe relief")
    renderers: list[str] = Field(description="Names, in the order asked for")
    options: dict[str, Any] | None = Field(None, description="Options that ibrpipe relief was given")
    samples: int | Literal["adaptive"] = Field(
        1, description="Rays of a pixel; adaptive = several where it shows an edge"
    )
    videos: dict[str, str] = Field(default={}, description="Renderer to MP4 file")
    frames: list[RenderedFrame] = Field(description="All frames, renderer by renderer")
