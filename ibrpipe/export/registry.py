"""The exporters by name; nothing heavy is imported until one is asked for.

Other packages bring exporters by an entry point of the group `GROUP`, ``name = "module:EXPORTER"``, or call `register`.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Literal

from ibrpipe.config import StageConfig
from ibrpipe.errors import ConfigError, closest

GROUP = "ibrpipe.exporters"


@dataclass(frozen=True)
class Exporter:
    """One form.

    Attributes
    ----------
    name : str
        Lower-case letters, digits, ``-`` and ``_``.
    summary : str
        One sentence.
    write : callable
        ``write(source, target)``: read the asset folder `source`, write the file or folder `target`, whole or not at
        all. It may return a line to be told.
    suffixes : tuple of str
        Endings of files by which the form is chosen, such as ``.glb``; empty = it is a folder.
    takes : "asset", "run", "scene" or "any"
        What `source` is: an asset folder, a run folder, what `ibrpipe.read_scene` reads, or whatever folder was given.
    takes_notes : bool
        `write` takes a third argument: a YAML file of words to go with the asset.
    Options : model of settings, or None
        `write` takes a third argument: settings of this model.
    folders : tuple of str
        Names of folders by which the form is chosen, such as ``colmap``.
    """

    name: str
    summary: str
    write: Callable[..., str | None]
    suffixes: tuple[str, ...] = ()
    takes: Literal["asset", "run", "scene", "any"] = "asset"
    takes_notes: bool = False
    Options: type[StageConfig] | None = None
    folders: tuple[str, ...] = ()


_known: dict[str, str | Exporter] = {}


def register(name: str, exporter: str | Exporter) -> None:
    """Make an exporter known by `name`: itself, or ``module:EXPORTER``, which is imported when it is asked for.

    Raises
    ------
    ConfigError
        The name has another form or belongs to another exporter.
    """
    if not re.fullmatch(r"[a-z][a-z0-9_-]*", name):
        raise ConfigError(f"{name!r} is no name of an exporter; give lower-case letters, digits, - and _")
    if _known.get(name, exporter) != exporter:
        raise ConfigError(f"there is an exporter {name!r} already; choose another name")
    _known[name] = exporter


register("colmap", "ibrpipe.export.colmap:EXPORTER")
register("deep-exr", "ibrpipe.export.deep_exr:EXPORTER")
register("glb", "ibrpipe.export.glb:EXPORTER")
register("impostors", "ibrpipe.export.impostors:EXPORTER")
register("obj", "ibrpipe.export.obj:EXPORTER")
register("page", "ibrpipe.export.page.exporter:EXPORTER")
register("ply", "ibrpipe.export.ply:EXPORTER")
register("transforms", "ibrpipe.export.transforms:EXPORTER")
register("usdz", "ibrpipe.export.usdz:EXPORTER")


def known_exporters() -> tuple[str, ...]:
    """Return the names of all exporters, those of other packages last."""
    return tuple(dict.fromkeys((*_known, *_foreign())))


def find_exporter(name: str) -> Exporter:
    """Return the exporter called `name`.

    Raises
    ------
    ConfigError
        There is none, and the message names those that exist; or the package that brings it is broken.
    """
    if name not in known_exporters():
        raise ConfigError(f'there is no exporter "{name}"; {closest(name, known_exporters())}')
    stated = _known[name] if name in _known else _foreign()[name].value
    if isinstance(stated, Exporter):
        return stated
    module, _, attribute = stated.partition(":")
    try:
        found = getattr(import_module(module), attribute)
    except Exception as error:  # a foreign module may fail in any way
        told = " ".join(f"{type(error).__name__}: {error}".split())
        raise ConfigError(f"exporter {name!r} ({stated}) cannot be loaded ({told}); mend that package") from error
    if not isinstance(found, Exporter):
        raise ConfigError(f"exporter {name!r} ({stated}) is {type(found).__name__}, no Exporter; mend that package")
    return found


def exporter_for(target: Path, name: str | None) -> Exporter:
    """Return the exporter called `name`, or, without a name, the one that writes files such as `target`.

    Raises
    ------
    ConfigError
        There is none.
    """
    if name is not None:
        return find_exporter(name)
    for found in map(find_exporter, known_exporters()):
        if (target.suffix and target.suffix.lower() in found.suffixes) or target.name in found.folders:
            return found
    raise ConfigError(f"{target}: its name does not say its form; give --format {'|'.join(known_exporters())}")


@cache
def _foreign() -> dict[str, EntryPoint]:
    """Return the entry points of other packages by name."""
    return {entry.name: entry for entry in entry_points(group=GROUP)}
