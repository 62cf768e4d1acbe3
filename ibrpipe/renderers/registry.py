"""The renderers by name: a class each, imported when it is first asked for.

Other packages bring renderers by an entry point of the group `GROUP`, ``name = "module:Class"``, or call `register`.
"""

from __future__ import annotations

import logging
import re
from functools import cache
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from ibrpipe.config import StageConfig
from ibrpipe.errors import RendererError
from ibrpipe.renderers.renderer import Renderer

GROUP = "ibrpipe.renderers"

AnyRenderer = type[Renderer[Any, Any]]

_log = logging.getLogger(__name__)
_known: dict[str, str | AnyRenderer] = {}


def register(name: str, renderer: str | AnyRenderer) -> None:
    """Make a renderer known by `name` in this process.

    Parameters
    ----------
    name : str
        Lower-case letters, digits, ``-`` and ``_``.
    renderer : type or str
        A subclass of `Renderer`, or ``module:Class``, which is imported when the renderer is first asked for.

    Raises
    ------
    RendererError
        The name has another form or belongs to another renderer, or the class is no renderer.
    """
    if not re.fullmatch(r"[a-z][a-z0-9_-]*", name):
        raise RendererError(f"{name!r} is no name of a renderer; give lower-case letters, digits, - and _")
    if _known.get(name, renderer) != renderer:
        raise RendererError(f"there is a renderer {name!r} already ({_known[name]}); choose another name")
    _known[name] = renderer if isinstance(renderer, str) else _checked(name, renderer)


register("ldi", "ibrpipe.renderers.ldi:LdiRenderer")
register("epipolar", "ibrpipe.renderers.epipolar:EpipolarRenderer")
register("prewarp", "ibrpipe.renderers.prewarp:PrewarpRenderer")
register("splat", "ibrpipe.renderers.splat:SplatRenderer")
register("relief", "ibrpipe.renderers.relief:ReliefRenderer")
register("hierarchical", "ibrpipe.renderers.hierarchical:HierarchicalRenderer")

#: the renderers that ibrpipe brings
BUILT_IN = tuple(_known)


def find_renderer(name: str) -> AnyRenderer:
    """Return the class of the renderer called `name`.

    Raises
    ------
    RendererError
        There is none, and the message names those that exist; or the package that brings it is broken.
    """
    if name in _known:
        return _loaded(name)
    if name in _foreign():
        return _from_package(_foreign()[name])
    raise RendererError(f"unknown renderer {name!r}; use one of: {', '.join(sorted({*_known, *_foreign()}))}")


def registered() -> dict[str, AnyRenderer]:
    """Return all renderers by name, those of other packages last; a broken one is told and left out."""
    found = {name: _loaded(name) for name in _known}
    for name, entry in _foreign().items():
        if name in found:
            _tell(f"renderer {name!r}{_package(entry)} is left out: there is another one of that name")
            continue
        try:
            found[name] = _from_package(entry)
        except RendererError as error:
            _tell(str(error))
    return found


def shows_view_dependence(name: str) -> bool:
    """Say whether the renderer called `name` draws view dependence and can be asked not to (option `residuals`)."""
    return "residuals" in find_renderer(name).Options.model_fields


def _loaded(name: str) -> AnyRenderer:
    known = _known[name]
    if isinstance(known, str):
        module, _, attribute = known.partition(":")
        try:
            known = _checked(name, getattr(import_module(module), attribute, None))
        except ImportError as error:
            raise RendererError(f"renderer {name!r} cannot be loaded from {_known[name]}: {error}") from error
        _known[name] = known
    return known


@cache
def _foreign() -> dict[str, EntryPoint]:
    """Return the entry points of other packages by name."""
    return {entry.name: entry for entry in entry_points(group=GROUP)}


@cache
def _from_package(entry: EntryPoint) -> AnyRenderer:
    """Load the renderer of another package; whatever is wrong with it becomes one line."""
    try:
        return _checked(entry.name, entry.load())
    except Exception as error:  # foreign code may raise anything when it is imported
        told = " ".join(f"{type(error).__name__}: {error}".split())
        raise RendererError(
            f"renderer {entry.name!r}{_package(entry)} cannot be loaded ({told}); mend or remove that package"
        ) from error


def _package(entry: EntryPoint) -> str:
    return f" of package {entry.dist.name} {entry.dist.version}" if entry.dist else ""


@cache
def _tell(line: str) -> None:
    """Log a line once."""
    _log.warning("%s", line)


def _checked(name: str, found: Any) -> AnyRenderer:
    """Return `found` if it is a class that keeps the contract."""
    if not (isinstance(found, type) and issubclass(found, Renderer)):
        raise RendererError(f"renderer {name!r} is {found!r}, no subclass of ibrpipe.renderers.renderer.Renderer")
    missing = [each for each in Renderer.__annotations__ if not hasattr(found, each)]
    missing += sorted(found.__abstractmethods__)
    if missing:
        raise RendererError(f"renderer {name!r} lacks {', '.join(missing)}; {found.__name__} must state all of them")
    if found.name != name:
        raise RendererError(f"renderer {name!r} calls itself {found.name!r}; give it one name")
    if not issubclass(found.Options, StageConfig):
        raise RendererError(f"renderer {name!r}: Options is {found.Options!r}; derive it from RendererOptions")
    return found
