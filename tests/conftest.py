"""Fixtures for all tests: tiny synthetic captures, made once per session. Copy them before changing anything."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numba
import numpy as np
import pytest
from hypothesis import HealthCheck, settings

# how long an example takes says nothing about the code on a machine that others use, too
settings.register_profile("unhurried", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("unhurried")


@pytest.fixture(autouse=True)
def quiet_as_compiled():
    """With the compiler off, let divisions by zero, infinities and NaN be as quiet as in compiled code."""
    with np.errstate(**({"all": "ignore"} if numba.config.DISABLE_JIT else {})):
        yield


@pytest.fixture(scope="session")
def make_tiny(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """Return a function from a scene's name to its capture folder, 14 photos and 3 tests of 96 x 72 pixels."""
    from ibrpipe.synthetic.capture import TINY, write_capture

    made: dict[str, Path] = {}

    def make(scene: str) -> Path:
        if scene not in made:
            made[scene] = write_capture(scene, tmp_path_factory.mktemp("captures") / scene, TINY)
        return made[scene]

    return make


@pytest.fixture(scope="session")
def tiny_glossy(make_tiny: Callable[[str], Path]) -> Path:
    """Capture folder of a glossy ball with a ring around it."""
    return make_tiny("glossy")


@pytest.fixture(scope="session")
def tiny_lambert(make_tiny: Callable[[str], Path]) -> Path:
    """Capture folder of a matt wall with a ring before it."""
    return make_tiny("lambert")


@pytest.fixture(scope="session")
def tiny_ball(make_tiny: Callable[[str], Path]) -> Path:
    """Capture folder of a glossy unit ball."""
    return make_tiny("ball")


@dataclass(frozen=True)
class Measured:
    """A capture after ingest: its folder, mesh and photos."""

    folder: Path
    caster: object
    photos: object


@pytest.fixture(scope="session")
def measured(make_tiny: Callable[[str], Path], tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Measured]:
    """Return a function from a scene's name to its ingested capture."""
    from ibrpipe.capture.photo_set import load_photos
    from ibrpipe.embree import MeshCaster
    from ibrpipe.io.surfaces.meshes import read_mesh
    from ibrpipe.io.views import read_views
    from ibrpipe.stages import ingest

    made: dict[str, Measured] = {}

    def make(scene: str) -> Measured:
        if scene not in made:
            folder = tmp_path_factory.mktemp("ingested") / scene
            done = ingest.run(ingest.Inputs(make_tiny(scene), folder), ingest.IngestConfig())
            caster = MeshCaster(read_mesh(done.given))
            made[scene] = Measured(folder, caster, load_photos(read_views(done.views).train, caster))
        return made[scene]

    return make
