"""Everything that a checkout imports is installed, and its rooms stay of a size that can be read."""

from __future__ import annotations

import tomllib
from collections import Counter
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


def test_modules_and_folders_stay_readable() -> None:
    modules = sorted((ROOT / "ibrpipe").rglob("*.py"))
    lines = {str(path.relative_to(ROOT)): len(path.read_text(encoding="utf-8").splitlines()) for path in modules}
    assert {name: count for name, count in lines.items() if count > 400} == {}
    tests = Path(__file__).parent.rglob("*.py")
    beside = Counter(str(path.parent.relative_to(ROOT)) for path in (*modules, *tests))
    assert {folder: count for folder, count in beside.items() if count > 20} == {}
