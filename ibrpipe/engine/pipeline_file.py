"""Pipeline files: a name, a seed, and the settings of every stage."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, Field, create_model, field_validator

from ibrpipe import config
from ibrpipe.config import StageConfig
from ibrpipe.engine.stage import Stage
from ibrpipe.errors import ConfigError, MissingFileError, closest
from ibrpipe.io.yaml_settings import Settings, parse, renamed, take_current_names, validated, value_of


@dataclass(frozen=True)
class Pipeline:
    """A loaded pipeline file.

    Attributes
    ----------
    name : str
        What the file calls itself.
    seed : int
        The one seed of all random numbers.
    configs : dict
        Stage name to its settings.
    """

    name: str
    seed: int
    configs: dict[str, StageConfig]


def pipeline_model(stages: Iterable[Stage]) -> type[BaseModel]:
    """Return the pydantic model of pipeline files over `stages`."""
    fields: dict[str, Any] = {
        "name": (str, Field("unnamed", min_length=1, description="What the run is called in its report")),
        "seed": (int, Field(0, ge=0, lt=2**32, description="Seed of all random numbers")),
    }
    configs: dict[str, Any] = {stage.name: (stage.config, _section(stage)) for stage in stages}
    no_value_means_defaults = field_validator(*configs, mode="before")(lambda value: {} if value is None else value)
    return create_model(
        "PipelineConfig",
        __config__=ConfigDict(frozen=True, extra="forbid"),
        __validators__={"no_value_means_defaults": no_value_means_defaults},
        **fields,
        **configs,
    )


def _section(stage: Stage) -> Any:
    return Field(default_factory=stage.config, description=stage.summary)


def load_pipeline(
    path: Path, stages: Sequence[Stage], changes: Sequence[str] = (), values: Mapping[str, Any] | None = None
) -> Pipeline:
    """Read a pipeline file and apply `changes` of the form ``stage.key=value``.

    Parameters
    ----------
    path : Path
        A file, or the name of a pipeline that comes with ibrpipe, such as ``mesh``.
    stages : sequence of Stage
        The stages that the file may name.
    changes : sequence of str
        Settings that replace those of the file; values are YAML.
    values : mapping, optional
        The same as ``stage.key`` to plain values.

    Raises
    ------
    MissingFileError
        There is no such file.
    ConfigError
        The file or a change is wrong; one line names the place, the key, and the closest valid one.
    """
    found = find_pipeline(path)
    try:
        settings = parse(found.read_text(encoding="utf-8"), str(found))
    except UnicodeDecodeError as error:
        raise ConfigError(f"{found}: not UTF-8 text; save it as UTF-8") from error
    model = pipeline_model(stages)
    take_current_names(model, settings)
    for change in changes:
        apply_change(settings, change, model)
    for key, value in (values or {}).items():
        settings.put(renamed(model, tuple(key.split("."))), value, f"settings[{key!r}]")
    filled = validated(model, settings)
    configs = {stage.name: getattr(filled, stage.name) for stage in stages}
    return Pipeline(filled.name, filled.seed, configs)  # type: ignore[attr-defined]


def apply_change(settings: Settings, change: str, model: type[BaseModel]) -> None:
    """Apply one ``stage.key=value`` to `settings`."""
    key, equals, text = change.partition("=")
    parts = tuple(part.strip() for part in key.split("."))
    if not equals or not all(parts):
        raise ConfigError(f"--set {change}: expected stage.key=value, for example layers.bins=32")
    settings.put(renamed(model, parts), value_of(text, f"--set {change}"), f"--set {change}")


def pipeline_folders() -> tuple[Path, ...]:
    """Return the folders that may hold the pipelines that come with ibrpipe: installed, and in a checkout."""
    package = Path(config.__file__).parent
    return package / "pipelines", package.parent / "pipelines"


def packaged_pipelines() -> dict[str, Path]:
    """Return the pipelines that come with ibrpipe, name to file."""
    for folder in pipeline_folders():
        files = sorted(folder.glob("*.yaml"))
        if files:
            return {file.stem: file for file in files}
    return {}


def find_pipeline(path: Path) -> Path:
    """Return the file meant by `path`: itself, or a pipeline that comes with ibrpipe, by its name or file name.

    Raises
    ------
    MissingFileError
        Neither exists.
    """
    if path.is_file():
        return path
    packaged = packaged_pipelines()
    if path.stem in packaged and path.parent.name in {"", "pipelines"}:
        return packaged[path.stem]
    raise MissingFileError(f"there is no pipeline file {path}; of those that come with ibrpipe, {_advice(path)}")


def _advice(path: Path) -> str:
    return closest(path.stem, packaged_pipelines())
