"""What a page says beside the object: title, credit, annotations, saved views; read from a YAML file."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field

from ibrpipe.config import Document
from ibrpipe.errors import FormatError, MissingFileError
from ibrpipe.io.yaml_settings import parse, validated

Point = tuple[float, float, float]


class Annotation(Document):
    """A text at a point of the object."""

    at: Point = Field(description="World coordinates, scene units")
    text: str = Field(description="What is told there")
    title: str = Field("", description="Its heading")
    eye: Point | None = Field(None, description="Where the camera goes when it is chosen; absent = it stays")


class SavedView(Document):
    """A place of the camera, by name."""

    name: str = Field(description="As it stands in the list of views")
    eye: Point = Field(description="Where the camera is, world coordinates")
    target: Point = Field(description="What it looks at")


class PageNotes(Document):
    """A page's words."""

    title: str = Field("", description="Heading; absent = the folder's name")
    description: str = Field("", description="A sentence or two below it")
    credit: str = Field("", description="Who made the object, the photos, the asset")
    license: str = Field("", description="Licence, as text")
    units: str = Field("", description="Name of the scene unit, such as mm; absent = as the asset says")
    up: Point | None = Field(None, description="Direction in the world that is up; absent = as the photos stand")
    photos: int = Field(12, ge=0, le=1000, description="Held-out photos of a run to compare with, at most; 0 = none")
    annotations: tuple[Annotation, ...] = Field((), description="Points with text")
    views: tuple[SavedView, ...] = Field((), description="Views to choose from")


def read_notes(path: Path) -> PageNotes:
    """Read a page's words.

    Raises
    ------
    MissingFileError, FormatError
        There is no such file, or it is no text.
    ConfigError
        It is no YAML, or a key or value is wrong; the message names the line.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except (FileNotFoundError, IsADirectoryError) as error:
        raise MissingFileError(f"{path}: no such file; give a YAML file with title, credit, annotations") from error
    except UnicodeDecodeError as error:
        raise FormatError(f"{path}: not a text in UTF-8; save it as that") from error
    return validated(PageNotes, parse(text, path.name))
