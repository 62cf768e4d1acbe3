"""Command-line options: the shared ones, and those made of the fields of a stage's settings."""

from __future__ import annotations

import types
from collections.abc import Callable, Collection, Sequence
from pathlib import Path
from typing import Any, Literal, Union, get_args, get_origin

import click
import yaml
from click.core import ParameterSource
from pydantic.fields import FieldInfo

from ibrpipe.cli.completion import OF_FIELDS
from ibrpipe.config import StageConfig
from ibrpipe.errors import ConfigError
from ibrpipe.io.yaml_settings import value_of

workers_option = click.Option(
    ["--workers"],
    type=click.IntRange(min=0),
    default=0,
    metavar="N",
    help="Threads to use; 0 = all cores. The result is the same for any number.",
)
dask_option = click.Option(
    ["--dask"], metavar="ADDRESS", help="Send work units to this Dask scheduler, such as tcp://host:8786."
)
json_option = click.Option(["--json", "as_json"], is_flag=True, help="Print the figures as JSON on stdout.")


def example(*lines: str) -> str:
    """Return the epilog that shows how to call a command."""
    return "\b\nExample:\n" + "\n".join(f"  {line}" for line in lines)


def out_option(text: str, default: str = "out") -> click.Option:
    """Return the option --out."""
    return click.Option(["--out"], type=PATH, metavar="DIR", default=default, show_default=True, help=text)


class YamlValue(click.ParamType):
    """Any value, written as YAML, for settings that are lists or mappings."""

    name = "yaml"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Parse the text."""
        try:
            return value_of(value, "value") if isinstance(value, str) else value
        except ConfigError as error:
            self.fail(str(error), param, ctx)


class LiteralChoice(click.Choice[str]):
    """One of several values, of which some may be numbers: these stay numbers."""

    def __init__(self, values: Sequence[Any]) -> None:
        super().__init__([str(value) for value in values])
        self._values = {str(value): value for value in values}

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the value whose text was given."""
        return self._values[super().convert(str(value), param, ctx)]


PATH = click.Path(path_type=Path)

#: of commands that sample a mesh
mesh_color_option = click.option(
    "--color", type=PATH, metavar="FILE", help="Image on the mesh's texture coordinates, instead of its own colours."
)


def config_options(config: type[StageConfig], only: Collection[str] | None = None) -> list[click.Option]:
    """Return one option for every field of `config`, or for those in `only`, with its help, bounds and default."""
    return [_option(name, field) for name, field in config.model_fields.items() if only is None or name in only]


def _option(name: str, field: FieldInfo) -> click.Option:
    flag = "--" + name.replace("_", "-")
    annotation, optional = _without_none(field.annotation)
    default = field.get_default(call_default_factory=True)
    help_text = " ".join((field.description or "").split())
    if annotation is bool and not optional:
        names = f"{flag}/--no-{flag[2:]}"
        return click.Option([names, name], default=default, show_default=True, help=help_text)
    kind, several = _kind(annotation, field)
    shown: bool | str = default is not None and default != ()
    if isinstance(kind, YamlValue) and shown:
        default, shown = None, yaml.safe_dump(_plain(default), default_flow_style=True).splitlines()[0]
    return click.Option(
        [flag, name],
        type=kind,
        multiple=several,
        default=default,
        show_default=shown,
        help=help_text,
        shell_complete=OF_FIELDS.get(name),
    )


def _without_none(annotation: Any) -> tuple[Any, bool]:
    """Split ``X | None`` into X and True."""
    if get_origin(annotation) in (Union, types.UnionType):
        rest = [each for each in get_args(annotation) if each is not types.NoneType]
        if len(rest) == 1:
            return rest[0], True
    return annotation, False


def _kind(annotation: Any, field: FieldInfo) -> tuple[click.ParamType, bool]:
    """Return the click type of an annotation, and whether the option may be given several times."""
    if get_origin(annotation) in (tuple, list):
        inner = get_args(annotation)
        if get_origin(annotation) is list or inner[1:] == (Ellipsis,):
            kind = _simple(inner[0], {})
            return (kind, True) if kind is not None else (YamlValue(), False)
    kind = _simple(annotation, _bounds(field))
    return (kind or YamlValue()), False


def _simple(annotation: Any, bounds: dict[str, Any]) -> click.ParamType | None:
    if get_origin(annotation) is Literal:
        return LiteralChoice(get_args(annotation))
    if annotation is int:
        return click.IntRange(**bounds) if bounds else click.INT
    if annotation is float:
        return click.FloatRange(**bounds) if bounds else click.FLOAT
    return {str: click.STRING, Path: PATH}.get(annotation)


def _bounds(field: FieldInfo) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for limit in field.metadata:
        for name, key, is_open in (("ge", "min", 0), ("gt", "min", 1), ("le", "max", 0), ("lt", "max", 1)):
            if getattr(limit, name, None) is not None:
                found[key] = getattr(limit, name)
                if is_open:
                    found[f"{key}_open"] = True
    return found


def _plain(value: Any) -> Any:
    """Return a default as plain YAML values."""
    if hasattr(value, "model_dump"):
        return value.model_dump(mode="json")
    if isinstance(value, (tuple, list)):
        return [_plain(each) for each in value]
    return value


def given(ctx: click.Context, names: Callable[[str], bool]) -> dict[str, Any]:
    """Return the values of the parameters that were written on the command line and whose name passes `names`."""
    return {
        name: list(value) if isinstance(value, tuple) else value
        for name, value in ctx.params.items()
        if names(name) and ctx.get_parameter_source(name) is ParameterSource.COMMANDLINE
    }
