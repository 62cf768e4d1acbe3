"""Options as they were given, checked against a renderer's `Options`; a wrong one is told in one line."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from pydantic import ValidationError

from ibrpipe.config import StageConfig
from ibrpipe.errors import RendererError
from ibrpipe.renderers.option_text import advice, default_text
from ibrpipe.renderers.renderer import Renderer

#: characters of a wrong value that a message shows
LONGEST = 60


def checked_options(renderer: type[Renderer[Any, Any]], options: Mapping[str, Any]) -> StageConfig:
    """Return the renderer's `Options` filled with `options`; NumPy's numbers count as Python's.

    Raises
    ------
    RendererError
        There is no such option, or a value is of the wrong type, NaN, or out of bounds; the message names renderer,
        option, the value met and what to give.
    """
    known = renderer.Options.model_fields
    unknown = sorted(set(options) - set(known))
    if unknown:
        raise RendererError(
            f"renderer {renderer.name!r} has no option {unknown[0]!r}; its options are: {', '.join(sorted(known))}"
        )
    plain = {name: value.item() if isinstance(value, np.generic) else value for name, value in options.items()}
    try:
        return renderer.Options.model_validate(plain)
    except ValidationError as error:
        raise RendererError(f"renderer {renderer.name!r}: {_told(renderer, plain, error)}") from None


def _told(renderer: type[Renderer[Any, Any]], options: Mapping[str, Any], error: ValidationError) -> str:
    problem = error.errors(include_url=False)[0]
    if not problem["loc"]:  # options that do not go together
        return " ".join(problem["msg"].removeprefix("Value error, ").split())
    name = str(problem["loc"][0])
    field = renderer.Options.model_fields[name]
    return f"{name} is {_short(options[name])}; {advice(field)} (default {default_text(field)})"


def _short(value: Any) -> str:
    if isinstance(value, np.ndarray) and value.size > 4:
        return f"an array of shape {value.shape} of {value.dtype}"
    text = " ".join(repr(value).split())
    return text if len(text) <= LONGEST else text[: LONGEST - 3] + "..."
