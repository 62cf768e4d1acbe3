"""Where the asset of a run lies, and what it is called."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ibrpipe.errors import MissingFileError
from ibrpipe.io.assets import INDEX
from ibrpipe.io.manifest import RUN_NAME

#: where the finished asset lies in a run folder, and the one that is not compressed yet
FINISHED, UNCOMPRESSED = "asset", "assembled"


def asset_folder(path: Path, places: Sequence[str] = (FINISHED, UNCOMPRESSED)) -> Path:
    """Return the asset folder that `path` is, or that of the run folder that it is.

    Parameters
    ----------
    path : Path
    places : sequence of str
        Where assets lie in a run, the finished one first.

    Raises
    ------
    MissingFileError
        It is a run that has made no asset yet.
    """
    for folder in (path, *(path / place for place in places)):
        if (folder / INDEX).is_file():
            return folder
    if (path / RUN_NAME).is_file():
        raise MissingFileError(f"{path}: this run has made no asset yet; go on with ibrpipe run and --out {path}")
    return path  # whoever reads it tells what is missing


def name_of(source: Path) -> str:
    """Return what an asset folder is called: the name of the run's folder, or its own."""
    folder = source.resolve()
    return folder.parent.name if folder.name in (FINISHED, UNCOMPRESSED) else folder.name
