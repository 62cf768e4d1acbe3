"""Fixtures for all tests: tiny synthetic captures, made once per session. Copy them before changing anything."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

# how long an example takes says nothing about the code on a machine that others use, too
settings.register_profile("unhurried", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("unhurried")


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
