"""What a stage is: a name, settings, inputs, and a function from paths to paths.

A stage module defines ``Inputs`` and ``Outputs`` (frozen dataclasses of paths and plain values), a `StageConfig`,
``run``, and one `Stage` object named ``STAGE`` that ties them together for the runner and the command line. ``run``
writes only inside ``inputs.out``; the runner gives it a temporary folder and renames it when ``run`` has returned.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from ibrpipe.config import StageConfig


class StageInputs(Protocol):
    """Every stage's inputs name the folder that it may write to."""

    @property
    def out(self) -> Path:
        """Folder that exists and that the stage fills."""


@dataclass(frozen=True)
class Stage:
    """One step of the pipeline.

    Attributes
    ----------
    name : str
        Name in pipeline files and on the command line.
    summary : str
        One sentence for ``--help``.
    inputs, config : type
        Dataclass of inputs and class of settings.
    run : callable
        ``run(inputs, config) -> outputs``.
    needs : tuple of str
        Names of the stages whose outputs it reads; "capture" stands for the capture folder.
    folder : str
        Folder below the run folder; the stage's name unless stated.
    example : str
        A command line that works, for ``--help`` and the docs.
    """

    name: str
    summary: str
    inputs: type
    config: type[StageConfig]
    run: Callable[[Any, Any], Any]
    needs: tuple[str, ...]
    example: str
    folder: str = ""

    @property
    def place(self) -> str:
        """Folder below the run folder."""
        return self.folder or self.name
