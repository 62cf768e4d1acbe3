"""Where the asset of a run lies, what it is called, and what its lengths are in."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ibrpipe.errors import MissingFileError
from ibrpipe.io.assets import INDEX
from ibrpipe.io.manifest import RUN_NAME
from ibrpipe.types import Asset

#: where the finished asset lies in a run folder, and the one that is not compressed yet
FINISHED, UNCOMPRESSED = "asset", "assembled"
#: where a run's mesh lies, and what it says of its vertices
MESH, CONFIDENCE = "geometry/mesh.ply", "confidence"
#: what assets say of their units when nobody knows them
UNKNOWN_UNITS = "scene units"


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
    found = found_asset(path, places)
    if found is not None:
        return found
    if (path / RUN_NAME).is_file():
        raise MissingFileError(f"{path}: this run has made no asset yet; go on with ibrpipe run and --out {path}")
    return path  # whoever reads it tells what is missing


def found_asset(path: Path, places: Sequence[str] = (FINISHED, UNCOMPRESSED)) -> Path | None:
    """Return the asset folder that `path` is, or that of the run folder that it is; None where there is none."""
    return next((each for each in (path, *(path / place for place in places)) if (each / INDEX).is_file()), None)


def name_of(source: Path) -> str:
    """Return what an asset folder is called: the name of the run's folder, or its own."""
    folder = source.resolve()
    return folder.parent.name if folder.name in (FINISHED, UNCOMPRESSED) else folder.name


def units_of(asset: Asset) -> str:
    """Return the name of the unit of length; empty where nobody knows it."""
    told = str(asset.info.get("units", ""))
    return "" if told.startswith(UNKNOWN_UNITS) else told
