"""What the child process is asked to do, as plain values that travel in one JSON file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter

from ibrpipe.io.cameras.lenses import Lens


@dataclass(frozen=True)
class PhotoEntry:
    """A photo to calibrate.

    Attributes
    ----------
    name : str
        Name in the joint model: the photo's, below ``images/``; those of ``test/`` begin with ``test/``.
    image, mask : str, str or None
        Files.
    mask_from_alpha : bool
    mask_rule : str
        As `ibrpipe.io.views.View`.
    lens : tuple or None
        Model, parameters, width and height that are known; None = to be found.
    pose : tuple of 12 floats or None
        ``cam_from_world`` row by row, where it is given.
    held_out : bool
        A photo of ``test/``.
    """

    name: str
    image: str
    mask: str | None = None
    mask_from_alpha: bool = False
    mask_rule: str = "coverage"
    lens: tuple[str, tuple[float, ...], int, int] | None = None
    pose: tuple[float, ...] | None = None
    held_out: bool = False

    def known_lens(self) -> Lens | None:
        """Return the lens that is known."""
        return None if self.lens is None else Lens(self.lens[0], tuple(self.lens[1]), self.lens[2], self.lens[3])


@dataclass(frozen=True)
class Job:
    """Everything that the child process needs.

    Attributes
    ----------
    photos : tuple of PhotoEntry
        In the order of their names.
    config : dict
        Settings of the calibrate stage.
    refine : bool
        The poses are given and only refined.
    seed, threads : int
    work : str
        Folder for what is half done.
    result : str
        Folder that receives the model and ``result.json``.
    """

    photos: tuple[PhotoEntry, ...]
    config: dict[str, Any]
    refine: bool
    seed: int
    threads: int
    work: str
    result: str


_JOB = TypeAdapter(Job)


def write_job(job: Job, path: Path) -> None:
    """Write a job as JSON."""
    path.write_bytes(_JOB.dump_json(job))


def read_job(path: Path) -> Job:
    """Read what `write_job` has written."""
    return _JOB.validate_json(path.read_bytes())
