"""The order of stages: every stage comes after those that make what it reads."""

from __future__ import annotations

from collections.abc import Sequence

from ibrpipe.engine.artifacts import GIVEN, input_fields
from ibrpipe.engine.stage import Stage
from ibrpipe.errors import ConfigError


def in_order(stages: Sequence[Stage]) -> tuple[Stage, ...]:
    """Return `stages` so that each stands right behind the last of those whose artifacts it reads or replaces.

    Raises
    ------
    ConfigError
        Nothing makes what a stage must have, stages wait for each other, or two write to one folder.
    """
    _check_folders(stages)
    placed: list[Stage] = []
    waiting = list(stages)
    while waiting:
        ready = next((stage for stage in waiting if not _awaited(stage, placed, waiting)), None)
        if ready is None:
            raise ConfigError(_deadlock(waiting[0], _awaited(waiting[0], placed, waiting), waiting))
        waiting.remove(ready)
        placed.insert(_position(ready, placed), ready)
    return tuple(placed)


def _made(stages: Sequence[Stage]) -> set[str]:
    return {made.name for stage in stages for made in stage.outputs.artifacts()}


def _awaited(stage: Stage, placed: Sequence[Stage], waiting: Sequence[Stage]) -> list[str]:
    """Return the inputs that a stage must wait for."""
    there = _made(placed).union(GIVEN)
    coming = _made([each for each in waiting if each is not stage])
    return [
        name for name, required in input_fields(stage).items() if name not in there and (required or name in coming)
    ]


def _position(stage: Stage, placed: Sequence[Stage]) -> int:
    touched = set(input_fields(stage)) | _made([stage])
    if "run" in touched:  # it looks at all that was done
        return len(placed)
    return max((n + 1 for n, each in enumerate(placed) if touched & _made([each])), default=0)


def _deadlock(stage: Stage, awaited: Sequence[str], waiting: Sequence[Stage]) -> str:
    makers = [each.name for each in waiting if each is not stage and set(awaited) & _made([each])]
    if makers:
        return f"stages {stage.name} and {makers[0]} wait for each other; let one of them do without {awaited[0]}"
    return f'stage {stage.name} has an input "{awaited[0]}" that nothing provides; correct its name or add its stage'


def _check_folders(stages: Sequence[Stage]) -> None:
    owners: dict[str, str] = {}
    for stage in stages:
        other = owners.setdefault(stage.folder, stage.name)
        if other != stage.name:
            raise ConfigError(f"stages {other} and {stage.name} both write to the folder {stage.folder}; rename one")
