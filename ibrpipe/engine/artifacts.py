"""Where the inputs of a stage are found: in the capture folder, or at their places in a run folder."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ibrpipe.engine.stage import Stage
from ibrpipe.errors import ConfigError, MissingFileError
from ibrpipe.io.manifest import Hasher, digest

#: input name -> path below the run folder
PLACES = {
    "calibration": "calibrate",
    "views": "ingest/views.json",
    "given": "ingest/mesh.ply",
    "points": "ingest/points.npz",
    "mesh": "geometry/mesh.ply",
    "plan": "plan/plan.json",
    "layers": "layers",
    "residuals": "residuals",
    "asset": "asset",
    "frames": "render",
    "run": ".",
}

#: what the inputs are, for --help
MEANING = {
    "capture": "Capture folder: images; cameras and mesh where there are any.",
    "calibration": "Folder of the calibrate stage.",
    "views": "views.json of the ingest stage.",
    "given": "The capture's own mesh (PLY).",
    "points": "Sparse points of the calibration (NPZ).",
    "mesh": "Mesh of the object (PLY).",
    "plan": "plan.json of the plan stage.",
    "layers": "Folder of the layers stage.",
    "residuals": "Folder of the residuals stage.",
    "asset": "Asset folder.",
    "frames": "Folder of the render stage.",
    "run": "Run folder.",
    "seed": "Seed of all random numbers.",
}


def input_fields(stage: Stage) -> dict[str, bool]:
    """Return the input names of a stage, without `out`, each with whether it must be given."""
    missing = dataclasses.MISSING
    return {
        field.name: field.default is missing and field.default_factory is missing
        for field in dataclasses.fields(stage.inputs)
        if field.name != "out"
    }


def wire(stage: Stage, run: Path, capture: Path | None, seed: int) -> dict[str, Any]:
    """Return the inputs of a stage inside the run folder `run`, name to value, without `out`.

    Raises
    ------
    MissingFileError
        One does not exist.
    """
    wired: dict[str, Any] = {}
    for name, required in input_fields(stage).items():
        if name == "seed":
            wired[name] = seed
            continue
        path = _path_of(name, stage, run, capture)
        if path is not None and path.exists():
            wired[name] = path
        elif required:
            raise MissingFileError(_absence(name, path, stage))
    return wired


def _path_of(name: str, stage: Stage, run: Path, capture: Path | None) -> Path | None:
    if name == "capture":
        return capture
    if name not in PLACES:
        raise ConfigError(
            f'stage {stage.name} has an input "{name}" that nothing provides; known: {", ".join(MEANING)}'
        )
    return run / PLACES[name]


def _absence(name: str, path: Path | None, stage: Stage) -> str:
    if name == "capture" and path is None:
        return f"stage {stage.name} needs photos; give their folder with --capture"
    if name == "capture":
        return f"there is no capture folder {path}; give the right one with --capture"
    return f"stage {stage.name} needs {path}, which does not exist; run the earlier stages first"


def hashes(fields: Mapping[str, Any], hasher: Hasher, leave_out: Path) -> dict[str, str]:
    """Return input name to content hash; of the capture the folder counts too, because results name its photos."""
    found: dict[str, str] = {}
    for name, value in fields.items():
        if name == "run":
            continue  # what is read there is named by the other inputs and by the keys of the earlier stages
        if not isinstance(value, Path):
            found[name] = str(value)
        elif name == "capture":
            found[name] = digest([str(value.resolve()), hasher.tree(value, [leave_out])])
        else:
            found[name] = hasher.tree(value)
    return found


def files_named(config: Mapping[str, Any], hasher: Hasher) -> dict[str, str]:
    """Return the hashes of files and folders that settings name, such as a camera path."""
    found: dict[str, str] = {}
    for name, value in config.items():
        if isinstance(value, Mapping):
            found.update({f"{name}.{key}": known for key, known in files_named(value, hasher).items()})
        elif isinstance(value, str) and _exists(value):
            found[name] = hasher.tree(Path(value))
    return found


def _exists(text: str) -> bool:
    """Say whether a setting that looks like a path names something on disk."""
    if not any(mark in text for mark in "/\\."):
        return False
    try:
        return Path(text).exists()
    except (OSError, ValueError):
        return False
