"""What shells complete beyond commands, options and files: pipelines, renderers, settings and their values.

Nothing here may fail or be slow: it answers while somebody types. Modules are imported when they are asked.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any, Literal, get_args, get_origin

import click
from click.shell_completion import CompletionItem
from pydantic import BaseModel

Complete = Callable[[click.Context, click.Parameter, str], list[CompletionItem]]


def pipelines_or_files(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Complete the names of pipelines that come with ibrpipe, and whatever lies on disk."""
    from ibrpipe.engine.pipeline_file import packaged_pipelines

    return [*_beginning(packaged_pipelines(), incomplete), CompletionItem(incomplete, type="file")]


def renderers(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Complete the names of renderers, and behind a colon their options."""
    from ibrpipe.renderers.registry import registered

    name, colon, written = incomplete.partition(":")
    if not colon:
        return _beginning({each: entry.summary for each, entry in registered().items()}, name)
    if name not in registered():
        return []
    done, comma, last = written.rpartition(",")
    before = f"{name}:{done}{comma}"
    return [CompletionItem(f"{before}{item.value}") for item in _settings(registered()[name].Options, last)]


def camera_paths(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Complete the camera paths that have names, and files."""
    from ibrpipe.io.paths import OWN_PATHS

    return [*_beginning([*OWN_PATHS, "orbit"], incomplete), CompletionItem(incomplete, type="file")]


def pipeline_settings(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Complete ``stage.key=value`` of all stages."""
    from ibrpipe.engine.pipeline_file import pipeline_model
    from ibrpipe.stages.registry import load_stages

    return _settings(pipeline_model(load_stages()), incomplete)


def export_forms(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Complete the forms that `ibrpipe export` knows."""
    from ibrpipe.export.registry import known_exporters

    return _beginning(known_exporters(), incomplete)


def export_settings(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Complete ``key=value`` of all forms: which one is meant cannot be known while the line is not finished."""
    from ibrpipe.export.registry import find_exporter, known_exporters

    options = [find_exporter(name).Options for name in known_exporters()]
    items = {item.value: item for model in options if model for item in _settings(model, incomplete)}
    return list(items.values())


def schemas(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Complete the names of schemas."""
    from ibrpipe.cli.schema import models

    return _beginning(models(), incomplete)


#: settings of stages that have more to say than their type
OF_FIELDS: dict[str, Complete] = {"renderers": renderers, "path": camera_paths}


def _settings(model: type[BaseModel], incomplete: str) -> list[CompletionItem]:
    """Complete keys of a model, and behind ``=`` the values of keys that have but few."""
    key, equals, _ = incomplete.partition("=")
    known = dict(_keys(model, ""))
    if not equals:
        return _beginning({f"{name}=": meaning for name, (meaning, _) in known.items()}, key)
    values = known[key][1] if key in known else ()
    return _beginning((f"{key}={value}" for value in values), incomplete)


def _keys(model: type[BaseModel], before: str) -> Iterator[tuple[str, tuple[str, tuple[str, ...]]]]:
    """Yield every key with what it means and the words that its value may be."""
    for name, field in model.model_fields.items():
        kind = field.annotation
        if isinstance(kind, type) and issubclass(kind, BaseModel):
            yield from _keys(kind, f"{before}{name}.")
        else:
            yield f"{before}{name}", (field.description or "", _words(kind))


def _words(kind: Any) -> tuple[str, ...]:
    if kind is bool:
        return "true", "false"
    return tuple(str(each) for each in get_args(kind)) if get_origin(kind) is Literal else ()


def _beginning(names: Iterable[str], incomplete: str) -> list[CompletionItem]:
    """Return the names that begin so; where `names` is a mapping, with what they mean."""
    meanings = names if isinstance(names, Mapping) else {}
    return [CompletionItem(name, help=meanings.get(name)) for name in names if name.startswith(incomplete)]
