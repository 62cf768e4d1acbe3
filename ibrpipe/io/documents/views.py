"""What ``views.json`` holds: photos, and the pinhole cameras that they are seen through."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field

from ibrpipe.config import Document, Matrix33, Matrix34
from ibrpipe.io.untrusted.inside import is_file_name, shortened


def _file_name(name: str) -> str:
    if not is_file_name(name):
        raise ValueError(f"{shortened(name)!r} is no name for the files of a view")
    return name


_Factor = Annotated[float, Field(gt=0)]
#: of linear red, green and blue
Factors = tuple[_Factor, _Factor, _Factor]


class View(Document):
    """One photo and the pinhole camera that it is seen through."""

    name: Annotated[str, AfterValidator(_file_name)] = Field(
        description="Unique among the train or among the test views, fit for a file name"
    )
    image: str = Field(description="Photo file, relative to the document's root, or absolute")
    mask: str | None = Field(description="Mask file; null = none")
    mask_from_alpha: bool = Field(description="The photo's own alpha is the mask")
    mask_rule: Literal["coverage", "nonzero"] = Field(description="Values are coverage, or all but 0 count fully")
    mask_threshold: float | None = Field(
        None, description="Without a mask: what is brighter (display code, 0..1) is the object; null = all counts"
    )
    gain: float = Field(gt=0, description="Linear factor that undoes the photo's exposure")
    white_balance: Factors = Field((1.0, 1.0, 1.0), description="Linear factors of red, green and blue beside it")
    color_space: str | None = Field(description="Colour space of the photo; null = as the file declares")
    oriented: bool = Field(description="The file's orientation tag is obeyed")
    full_size: tuple[int, int] | None = Field(
        description="Width and height of the undistorted picture before shrinking; null = not shrunk"
    )
    depth: str | None = Field(
        description="File of known depth along camera z: truth of test views, or of an RGB-D camera; null = none"
    )
    held_out: bool = Field(description="For measuring only")
    width: int = Field(ge=1, description="Pixels")
    height: int = Field(ge=1, description="Pixels")
    K: Matrix33 = Field(description="Calibration, pixels; pixel (0, 0)'s centre is at (0.5, 0.5)")
    cam_from_world: Matrix34 = Field(description="Pose [R t], world to camera, OpenCV axes, scene units")
    distortion: tuple[str, list[float], int, int] | None = Field(
        description="COLMAP camera model, its parameters, width and height of the photo file; null = pinhole"
    )


class Views(Document):
    """``ingest/views.json``."""

    schema_version: Literal[1] = Field(alias="schema", description="Version of this layout")
    root: str = Field(description="Folder that relative photo paths start from; empty = the document's own")
    mesh: str | None = Field(description="Mesh file, relative to this document")
    info: dict[str, Any] = Field(description="Capture folder, exposure source, notes")
    train: list[View] = Field(description="Photos that the asset is made from")
    test: list[View] = Field(description="Photos that it is measured on")
