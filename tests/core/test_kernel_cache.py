"""The folder of compiled kernels follows every source that a module needs, and no other."""

from __future__ import annotations

from pathlib import Path

import pytest

from ibrpipe.core import jit


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "leaf.py").write_text("x = 1\n")
    (tmp_path / "middle.py").write_text("from ibrpipe.core.leaf import x\n")
    (tmp_path / "top.py").write_text("from ibrpipe.core import middle as m\n")
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
