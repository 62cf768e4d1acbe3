"""What a stage is: a name, settings, inputs, artifacts, and a function from paths to paths.

A stage module defines ``Inputs`` (a frozen dataclass of paths and plain values), ``Outputs`` (`StageOutputs` whose
fields are made by `artifact`), a `StageConfig`, ``run``, and one `Stage` object named ``STAGE`` that ties them together
for the runner and the command line. ``run`` writes only inside ``inputs.out``; the runner gives it a temporary folder
and renames it when ``run`` has returned.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, Self

from pydantic import BaseModel

from ibrpipe.config import StageConfig

_KEY = "artifact"


class StageInputs(Protocol):
    """Every stage's inputs name the folder that it may write to."""

    @property
    def out(self) -> Path:
        """Folder that exists and that the stage fills."""


@dataclass(frozen=True)
class Artifact:
    """A file or folder that a stage makes, and that later stages take as their input of the same name.

    Attributes
    ----------
    name : str
    path : str
        Relative to the stage's folder, with ``/``; empty = that folder.
    meaning : str
        What it is, for ``--help``.
    document : type or None
        The model of a JSON file.
    optional : bool
        The stage does not make it every time.
    """

    name: str
    path: str
    meaning: str
    document: type[BaseModel] | None = None
    optional: bool = False


def artifact(path: str, meaning: str, document: type[BaseModel] | None = None, optional: bool = False) -> Any:
    """Declare a field of ``Outputs`` as an `Artifact` of the field's name; an optional one may be None."""
    default: Any = None if optional else dataclasses.MISSING
    known = Artifact("", path, meaning, document, optional)
    return dataclasses.field(default=default, kw_only=True, metadata={_KEY: known})


@dataclass(frozen=True)
class StageOutputs:
    """Base of the frozen dataclasses that state what a stage makes."""

    @classmethod
    def artifacts(cls) -> tuple[Artifact, ...]:
        """Return what is declared, in order."""
        declared = [(each.name, each.metadata[_KEY]) for each in dataclasses.fields(cls) if _KEY in each.metadata]
        return tuple(dataclasses.replace(known, name=name) for name, known in declared)

    @classmethod
    def below(cls, folder: Path) -> Self:
        """Return where all artifacts belong when `folder` is the stage's own."""
        return cls(**{each.name: folder / each.path for each in cls.artifacts()})

    def made(self) -> Self:
        """Return the same with None for the optional artifacts that do not exist."""
        absent = [each.name for each in self.artifacts() if each.optional and not _exists(getattr(self, each.name))]
        return dataclasses.replace(self, **dict.fromkeys(absent))


def _exists(path: Path | None) -> bool:
    return path is not None and path.exists()


@dataclass(frozen=True)
class Stage:
    """One step of the pipeline.

    Attributes
    ----------
    name : str
        Name in pipeline files and on the command line.
    summary : str
        One sentence for ``--help``.
    inputs : type
        Dataclass of inputs. Each is named after the artifact that it takes; ``capture``, ``seed`` and ``run`` (the run
        folder) are there without a stage.
    outputs : type
        Dataclass of artifacts.
    config : type
        Class of settings.
    run : callable
        ``run(inputs, config) -> outputs``.
    example : str
        A command line that works, for ``--help`` and the docs.
    folder : str
        Folder below the run folder; the stage's name unless stated.
    """

    name: str
    summary: str
    inputs: type
    outputs: type[StageOutputs]
    config: type[StageConfig]
    run: Callable[[Any, Any], Any]
    example: str
    folder: str = ""

    def __post_init__(self) -> None:
        if not self.folder:
            object.__setattr__(self, "folder", self.name)

    def path_of(self, made: Artifact) -> str:
        """Return where one of its artifacts lies, relative to the run folder."""
        return f"{self.folder}/{made.path}".rstrip("/")
