"""Tiny synthetic captures after ingest, and what the plan needs to look at them; made once per session."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest


@dataclass(frozen=True)
class Measured:
    """A capture after ingest: its folder, mesh and photos."""

    folder: Path
    caster: object
    photos: object


@pytest.fixture(scope="session")
def measured(make_tiny: Callable[[str], Path], tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Measured]:
    """Return a function from a scene's name to its ingested capture."""
    from ibrpipe.embree import MeshCaster
    from ibrpipe.io.meshes import read_mesh
    from ibrpipe.io.views import read_views
    from ibrpipe.stages import ingest
    from ibrpipe.stages.photos import load_photos

    made: dict[str, Measured] = {}

    def make(scene: str) -> Measured:
        if scene not in made:
            folder = tmp_path_factory.mktemp("ingested") / scene
            done = ingest.run(ingest.Inputs(make_tiny(scene), folder), ingest.IngestConfig())
            caster = MeshCaster(read_mesh(done.mesh))
            made[scene] = Measured(folder, caster, load_photos(read_views(done.views).train, caster))
        return made[scene]

    return make
