"""Every stage by name, in the order of the pipeline; nothing heavy is imported until a stage is asked for."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

from ibrpipe.errors import ConfigError, closest

if TYPE_CHECKING:
    from ibrpipe.engine.stage import Stage

#: stage -> (where its `Stage` object is, what the list of commands says of it)
STAGES: dict[str, tuple[str, str]] = {
    "calibrate": ("ibrpipe.stages.calibrate:STAGE", "Find the cameras of photos that come without."),
    "ingest": ("ibrpipe.stages.ingest:STAGE", "Read and check a capture folder."),
    "geometry": ("ibrpipe.stages.geometry:STAGE", "Take the given mesh, or make one from the photos."),
    "plan": ("ibrpipe.stages.plan:STAGE", "Decide what to model, at which resolution, and why."),
    "layers": ("ibrpipe.stages.layers:STAGE", "Make layered depth images with diffuse colour."),
    "residuals": ("ibrpipe.stages.residuals:STAGE", "Model what changes with the view direction."),
    "asset": ("ibrpipe.stages.asset:STAGE", "Gather the results into an asset folder."),
    "render": ("ibrpipe.stages.render:STAGE", "Render an asset along a camera path."),
    "evaluate": ("ibrpipe.stages.evaluate:STAGE", "Score rendered views and write the report."),
}


def load_stage(name: str) -> Stage:
    """Import the stage `name`.

    Raises
    ------
    ConfigError
        There is no such stage.
    """
    if name not in STAGES:
        raise ConfigError(f'there is no stage "{name}"; {closest(name, STAGES)}')
    module, attribute = STAGES[name][0].split(":")
    stage: Stage = getattr(import_module(module), attribute)
    return stage


def load_stages() -> tuple[Stage, ...]:
    """Import all stages, in pipeline order."""
    return tuple(load_stage(name) for name in STAGES)
