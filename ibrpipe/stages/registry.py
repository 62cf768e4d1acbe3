"""Every stage by name; nothing heavy is imported until a stage is asked for.

Other packages add stages by entry points of the group ``ibrpipe.stages``, whose value leads to a `Stage` object, or by
`register`. Where a stage stands in the pipeline follows from what it reads and makes.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import cache
from importlib import import_module
from typing import TYPE_CHECKING, NamedTuple

from ibrpipe.errors import ConfigError, closest

if TYPE_CHECKING:
    from ibrpipe.engine.stage import Stage

GROUP = "ibrpipe.stages"
_NAME = re.compile(r"(?!(name|seed)$)[a-z][a-z0-9_]*")


class Entry(NamedTuple):
    """What is known of a stage before it is loaded: ``module:attribute``, its line of help, and who brings it."""

    where: str
    summary: str
    package: str = ""


_STAGES: dict[str, Entry] = {}


def register(name: str, where: str, summary: str) -> None:
    """Add a stage.

    Parameters
    ----------
    name : str
        Lower-case letters, digits and underscores.
    where : str
        ``module:attribute`` of its `Stage` object.
    summary : str
        What the list of commands says of it.

    Raises
    ------
    ConfigError
        The name is taken or none.
    """
    entry = Entry(where, summary)
    why = _refused(_STAGES, name, entry)
    if why is not None:
        raise ConfigError(why)
    _STAGES[name] = entry


def registered() -> dict[str, Entry]:
    """Return every stage by name: those that were registered, in that order, then those of other packages.

    What `load_stages` refuses by its name is left out.
    """
    known = dict(_STAGES)
    for name, entry in _entry_points():
        if _refused(known, name, entry) is None:
            known[name] = entry
    return known


@cache
def _entry_points() -> tuple[tuple[str, Entry], ...]:
    from importlib.metadata import entry_points

    found = []
    for point in sorted(entry_points(group=GROUP), key=lambda point: point.name):
        package = point.dist.name if point.dist is not None else point.value.partition(".")[0]
        found.append((point.name, Entry(point.value, f"Stage of the package {package}.", package)))
    return tuple(found)


def _refused(known: Mapping[str, Entry], name: str, entry: Entry) -> str | None:
    """Say why a stage cannot be added to those that are known, if so."""
    wanted = f", as the package {entry.package} wants it" if entry.package else ""
    if not _NAME.fullmatch(name):
        return f'"{name}" cannot be the name of a stage{wanted}; use lower-case letters, digits and underscores'
    if known.get(name, entry) is not entry:
        return f'there is a stage "{name}" already{wanted}; choose another name'
    return None


def load_stage(name: str) -> Stage:
    """Import the stage `name`.

    Raises
    ------
    ConfigError
        There is no such stage, or what another package brings is none.
    """
    known = registered()
    if name not in known:
        raise ConfigError(f'there is no stage "{name}"; {closest(name, known)}')
    entry = known[name]
    module, _, attribute = entry.where.partition(":")
    try:
        found = getattr(import_module(module), attribute)
    except Exception as error:  # a foreign module may fail in any way
        if not entry.package:
            raise
        raise ConfigError(_broken(name, entry, f"{type(error).__name__}: {error}")) from error
    return _checked(name, entry, found)


def _checked(name: str, entry: Entry, found: object) -> Stage:
    from ibrpipe.engine.stage import Stage

    if not isinstance(found, Stage):
        raise ConfigError(_broken(name, entry, f"expected a Stage, got {type(found).__name__}"))
    if found.name != name:
        raise ConfigError(_broken(name, entry, f'it calls itself "{found.name}"'))
    return found


def _broken(name: str, entry: Entry, why: str) -> str:
    remedy = f"update or uninstall the package {entry.package}" if entry.package else "correct it"
    return f"stage {name} at {entry.where} cannot be used: {' '.join(why.split())}; {remedy}"


def load_stages() -> tuple[Stage, ...]:
    """Import all stages, in the order of the pipeline.

    Raises
    ------
    ConfigError
        One cannot be used; the message says which, and what to do.
    """
    from ibrpipe.engine.order import in_order

    known = registered()
    for name, entry in _entry_points():
        why = _refused(known, name, entry)
        if why is not None:
            raise ConfigError(f"{why}, or uninstall the package")
    return in_order([load_stage(name) for name in known])


register("calibrate", "ibrpipe.stages.calibrate:STAGE", "Find the cameras of photos that come without.")
register("ingest", "ibrpipe.stages.ingest:STAGE", "Read and check a capture folder.")
register("geometry", "ibrpipe.stages.geometry:STAGE", "Take the given mesh, or make one from the photos.")
register("photometry", "ibrpipe.stages.photometry:STAGE", "Bring photos to one exposure, where theirs differ.")
register("plan", "ibrpipe.stages.plan:STAGE", "Decide what to model, at which resolution, and why.")
register("layers", "ibrpipe.stages.layers:STAGE", "Make layered depth images with diffuse colour.")
register("residuals", "ibrpipe.stages.residuals:STAGE", "Model what changes with the view direction.")
register("asset", "ibrpipe.stages.asset:STAGE", "Gather the results into an asset folder.")
register("compress", "ibrpipe.stages.compress:STAGE", "Code the asset compactly, to a size or an error.")
register("render", "ibrpipe.stages.render:STAGE", "Render an asset along a camera path.")
register("evaluate", "ibrpipe.stages.evaluate:STAGE", "Score rendered views and write the report.")
