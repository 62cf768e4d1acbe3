"""Options in words: what each may be, for messages, `ibrpipe.renderers` and the tables of the renderers' pages."""

from __future__ import annotations

import types
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic.fields import FieldInfo

from ibrpipe.config import StageConfig

#: of numbers, in words
_NUMBERS = {int: "a whole number", float: "a number"}


@dataclass(frozen=True)
class Expected:
    """Beside the type of a field: what it may be, in words, where its type does not tell."""

    words: str


def expected(field: FieldInfo) -> str:
    """Return what a field may be, such as ``a whole number from 0 to 64``."""
    told = [each.words for each in field.metadata if isinstance(each, Expected)]
    if told:
        return told[0]
    kinds = [field.annotation]
    if get_origin(field.annotation) in (Union, types.UnionType):
        kinds = sorted(get_args(field.annotation), key=lambda kind: get_origin(kind) is not Literal)
    words = [_kind(kind, field.metadata) for kind in kinds if kind is not types.NoneType]
    return ", or ".join(words + ["none"] * (types.NoneType in kinds))


def advice(field: FieldInfo) -> str:
    """Return what to give instead of a wrong value."""
    if get_origin(field.annotation) is Literal:
        return f"choose among: {', '.join(map(str, get_args(field.annotation)))}"
    return f"give {expected(field)}"


def _kind(kind: Any, limits: Sequence[Any]) -> str:
    if get_origin(kind) is Annotated:
        kind, *own = get_args(kind)
        limits = [limit for each in own for limit in getattr(each, "metadata", [each])]
    if get_origin(kind) is Literal:
        *others, last = map(str, get_args(kind))
        return f"{', '.join(others)} or {last}" if others else last
    if kind is bool:
        return "true or false"
    if kind in _NUMBERS:
        return _NUMBERS[kind] + _range(limits)
    return str(getattr(kind, "__name__", kind))


def _range(limits: Sequence[Any]) -> str:
    """Return the bounds of a number in words, with a blank before them."""
    bounds = {key: getattr(limit, key) for limit in limits for key in ("ge", "gt", "le", "lt") if hasattr(limit, key)}
    if "ge" in bounds and "le" in bounds:
        return f" from {bounds['ge']:g} to {bounds['le']:g}"
    words = {"ge": "of at least", "gt": "above", "le": "of at most", "lt": "below"}
    return "".join(f" {words[key]} {value:g}" for key, value in bounds.items())


def default_text(field: FieldInfo) -> str:
    """Return the default as it is written after ``key=``."""
    default = field.get_default(call_default_factory=True)
    if default is None or isinstance(default, bool):
        return str(default).lower()
    if isinstance(default, tuple):
        return " ".join(f"{each:g}" for each in default)
    return str(default)


def option_texts(options: type[StageConfig]) -> dict[str, str]:
    """Return, by name, what each option does, what it may be and its default."""
    return {
        name: f"{field.description} ({expected(field)}; default {default_text(field)})"
        for name, field in options.model_fields.items()
    }


def option_table(options: type[StageConfig]) -> str:
    """Return the options as a table in Markdown."""
    return "\n".join(["| option | may be | default | what it does |", "|---|---|---|---|", *_rows(options)]) + "\n"


def _rows(options: type[StageConfig]) -> Iterator[str]:
    for name, field in options.model_fields.items():
        yield f"| `{name}` | {expected(field)} | `{default_text(field)}` | {field.description} |"
