"""A capture whose camera files are replaced."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest


@pytest.fixture
def capture(tiny_ball: Path, tmp_path: Path) -> Path:
    """The capture with COLMAP's cameras alone and no test views."""
    root = Path(shutil.copytree(tiny_ball, tmp_path / "capture"))
    shutil.rmtree(root / "test")
    (root / "transforms.json").rename(tmp_path / "transforms.json")
    return root
