"""Where the inputs of a stage come from: the capture folder, or the artifact of that name that an earlier stage makes.

Of several stages that make an artifact of one name the latest before the reader counts. So a stage may replace what an
earlier one has made: it takes the earlier one as its input, and all stages after it take its own without knowing.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ibrpipe.engine.stage import Artifact, Stage
from ibrpipe.errors import ConfigError, MissingFileError
from ibrpipe.io.manifest import Hasher, digest
from ibrpipe.io.untrusted.inside import shortened

#: inputs that no stage makes, and what they are
GIVEN = {
    "capture": "Capture folder: images; cameras and mesh where there are any.",
    "run": "Run folder.",
    "seed": "Seed of all random numbers.",
}


@dataclass(frozen=True)
class Source:
    """A stage and one of its artifacts.

    Attributes
    ----------
    stage : Stage
    artifact : Artifact
    """

    stage: Stage
    artifact: Artifact

    @property
    def path(self) -> str:
        """Where the artifact lies, relative to the run folder."""
        return self.stage.path_of(self.artifact)


def input_fields(stage: Stage) -> dict[str, bool]:
    """Return the input names of a stage, without `out`, each with whether it must be given."""
    missing = dataclasses.MISSING
    return {
        field.name: field.default is missing and field.default_factory is missing
        for field in dataclasses.fields(stage.inputs)
        if field.name != "out"
    }


def products(stages: Sequence[Stage]) -> dict[str, Source]:
    """Return every artifact that `stages` make, by name; of one name the latest."""
    return {made.name: Source(stage, made) for stage in stages for made in stage.outputs.artifacts()}


def paths_below(run: Path, found: Mapping[str, Source]) -> dict[str, Path]:
    """Return where artifacts lie in the run folder `run`, by name."""
    return {name: run / source.path for name, source in found.items()}


def earlier(stage: Stage, stages: Sequence[Stage]) -> Sequence[Stage]:
    """Return the stages before `stage`; all where it is none of them."""
    names = [each.name for each in stages]
    return stages[: names.index(stage.name)] if stage.name in names else stages


def sources(stage: Stage, stages: Sequence[Stage]) -> dict[str, Source]:
    """Return where the inputs of a stage come from, by name; one that nothing provides may only be optional.

    Raises
    ------
    ConfigError
        No stage before it makes an input that it must have.
    """
    known, found = products(earlier(stage, stages)), dict[str, Source]()
    for name, required in input_fields(stage).items():
        if name in known:
            found[name] = known[name]
        elif required and name not in GIVEN:
            there = ", ".join([*GIVEN, *known])
            raise ConfigError(f'stage {stage.name} has an input "{name}" that nothing provides; known: {there}')
    return found


def needs(stage: Stage, stages: Sequence[Stage]) -> tuple[str, ...]:
    """Return the names of the stages whose artifacts a stage reads, in order; "capture" stands for the capture."""
    read = {source.stage.name for source in sources(stage, stages).values()}
    capture = ("capture",) if "capture" in input_fields(stage) else ()
    return (*capture, *(each.name for each in stages if each.name in read))


def wire(stage: Stage, stages: Sequence[Stage], run: Path, capture: Path | None, seed: int) -> dict[str, Any]:
    """Return the inputs of a stage inside the run folder `run`, name to value, without `out`.

    Raises
    ------
    MissingFileError
        One does not exist.
    ConfigError
        No stage makes it.
    """
    paths: dict[str, Path | None] = {**paths_below(run, sources(stage, stages)), "capture": capture, "run": run}
    wired: dict[str, Any] = {}
    for name, required in input_fields(stage).items():
        if name == "seed":
            wired[name] = seed
            continue
        path = paths.get(name)
        if name == "capture" and path is not None:
            check_capture(path)
        if path is not None and path.exists():
            wired[name] = path
        elif required:
            raise MissingFileError(_absence(name, path, stage))
    return wired


def check_capture(folder: Path) -> None:
    """Raise `MissingFileError` where a capture is no folder."""
    if not folder.is_dir():
        told = shortened(str(folder))
        raise MissingFileError(f"there is no capture folder {told}; give the right one with --capture")


def _absence(name: str, path: Path | None, stage: Stage) -> str:
    if name == "capture":
        return f"stage {stage.name} needs photos; give their folder with --capture"
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
