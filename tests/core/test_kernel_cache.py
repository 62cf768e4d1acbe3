"""The folder of compiled kernels follows every source that a module needs, and no other."""

from __future__ import annotations

import importlib.util
import shutil
import sys
from pathlib import Path
from typing import Any

import numba
import pytest

from ibrpipe.core import jit

CORE = Path(jit.__file__).parent


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "leaf.py").write_text("x = 1\n")
    (tmp_path / "method").mkdir()
    (tmp_path / "method" / "middle.py").write_text("from ibrpipe.core.leaf import x\n")
    (tmp_path / "top.py").write_text("from ibrpipe.core.method import middle as m\n")
    (tmp_path / "other.py").write_text("y = 1\n")
    monkeypatch.setattr(jit, "_HERE", str(tmp_path))
    return tmp_path


def digest(path: Path) -> str:
    jit._imported_kernels.cache_clear()
    jit._source_digest.cache_clear()
    return jit._source_digest(str(path))


def test_an_edit_two_imports_away_is_seen(package: Path) -> None:
    before = digest(package / "top.py")
    (package / "leaf.py").write_text("x = 2\n")
    assert digest(package / "top.py") != before


def test_kernels_of_a_method_see_each_other(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    copy = tmp_path / "core"
    shutil.copytree(CORE, copy)
    monkeypatch.setattr(jit, "_HERE", str(copy))
    before = digest(copy / "epipolar" / "cast.py")
    lines = copy / "epipolar" / "lines.py"
    lines.write_text(lines.read_text(encoding="utf-8") + "\n", encoding="utf-8")
    assert digest(copy / "epipolar" / "cast.py") != before


@pytest.mark.parametrize(
    "statement",
    [
        "import ibrpipe.core.method.middle",
        "import math, ibrpipe.core.method.middle as m",
        "from ibrpipe.core.method.middle import x",
        "from ibrpipe.core.method import (\n    other,  # of two\n    middle,\n)",
        "if True:\n    from ibrpipe.core.method import middle",
    ],
)
def test_every_form_of_import_is_followed(package: Path, statement: str) -> None:
    (package / "top.py").write_text(statement + "\n")
    test_an_edit_two_imports_away_is_seen(package)


def test_an_edit_elsewhere_is_not(package: Path) -> None:
    before = digest(package / "top.py")
    (package / "other.py").write_text("y = 2\n")
    assert digest(package / "top.py") == before


def test_a_folder_that_cannot_be_made_turns_the_cache_off(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("IBRPIPE_CACHE_DIR", str(tmp_path / "file"))
    jit._cache_folder.cache_clear()
    assert jit._cache_folder(jit.__file__) is None
    jit._cache_folder.cache_clear()


def compiled_at(folder: Path, source: str, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Return the kernel of a module that lies in `folder`, called once."""
    folder.mkdir()
    (folder / "leaf.py").write_text(source)
    monkeypatch.setattr(jit, "_HERE", str(folder))
    spec = importlib.util.spec_from_file_location("leaf", folder / "leaf.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, "leaf", module)
    spec.loader.exec_module(module)
    assert module.twice(3) == 6
    return module.twice


@pytest.mark.skipif(numba.config.DISABLE_JIT, reason="nothing is compiled")
def test_checkouts_share_what_is_the_same_in_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("IBRPIPE_CACHE_DIR", str(tmp_path / "cache"))
    source = "from ibrpipe.core.jit import helper\n\n\n@helper\ndef twice(x):\n    return 2 * x\n"
    first = compiled_at(tmp_path / "first", source, monkeypatch)
    second = compiled_at(tmp_path / "second", source, monkeypatch)
    edited = compiled_at(tmp_path / "third", source.replace("2 * x", "x + x"), monkeypatch)
    hits = [sum(each.stats.cache_hits.values()) for each in (first, second, edited)]
    assert hits == [0, 1, 0]
