"""A renderer with options, written as one word, such as ``epipolar:search=nearest``."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from ibrpipe.errors import RendererError
from ibrpipe.renderers.option_check import checked_options
from ibrpipe.renderers.registry import find_renderer

_WORDS: dict[str, Any] = {"true": True, "false": False, "none": None}


@dataclass(frozen=True)
class Choice:
    """One renderer and how it is asked to draw.

    Attributes
    ----------
    text : str
        As it was written; its name in files and reports.
    name : str
        Of the renderer.
    options : mapping
    """

    text: str
    name: str
    options: Mapping[str, Any] = field(default_factory=dict)

    @property
    def folder(self) -> str:
        """The text with nothing in it that a file system would mind."""
        return re.sub(r"[^A-Za-z0-9.=_-]", "-", self.text)


def with_samples(choice: Choice, samples: object) -> Choice:
    """Return the choice with so many rays a pixel, where it does not say itself, and its renderer has that option."""
    if "samples" in choice.options or "samples" not in find_renderer(choice.name).Options.model_fields:
        return choice
    return replace(choice, options={**choice.options, "samples": samples})


def choose(text: str) -> Choice:
    """Read ``name`` or ``name:key=value,...``; values are numbers (several with blanks between them), true, false,
    none, or words.

    Raises
    ------
    RendererError
        There is no such renderer or option, a value cannot be what it is, or the text has another form.
    """
    name, colon, rest = text.partition(":")
    renderer, options = find_renderer(name), {}
    for part in rest.split(",") if colon else ():
        key, equals, value = (each.strip() for each in part.partition("="))
        if not (equals and key and value):
            raise RendererError(f"{text!r}: expected {name}:key=value,...; {part!r} is no key=value")
        options[key] = _value(value)
    checked = checked_options(renderer, options)
    return Choice(text, name, {key: getattr(checked, key) for key in options})


def _value(text: str) -> Any:
    if text.lower() in _WORDS:
        return _WORDS[text.lower()]
    parts = text.split()
    if len(parts) > 1:
        return tuple(_value(part) for part in parts)
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    return text
