"""Everything that a checkout imports is in the package that is installed."""

from __future__ import annotations

import tomllib
from pathlib import Path

import ibrpipe

ROOT = Path(ibrpipe.__file__).parent.parent


def test_every_folder_of_modules_is_installed() -> None:
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    folders = {".".join(path.parent.relative_to(ROOT).parts) for path in (ROOT / "ibrpipe").rglob("*.py")}
    assert set(settings["tool"]["setuptools"]["packages"]) == folders | {"ibrpipe.pipelines"}


def test_every_folder_of_modules_says_what_it_is_for() -> None:
    folders = {path.parent for path in (ROOT / "ibrpipe").rglob("*.py")}
    bare = [str(folder) for folder in folders if not (folder / "__init__.py").read_text(encoding="utf-8").strip()]
    assert bare == []
