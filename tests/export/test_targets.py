"""Sources without an asset and targets that cannot be written are told before any work is done."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from page_assets import make_asset

import ibrpipe
from ibrpipe.errors import ConfigError, MissingFileError, ResourceError
from ibrpipe.export.asset_folders import FINISHED, UNCOMPRESSED, asset_folder, name_of
from ibrpipe.export.whole_file import check_file, check_folder

FILES = ["x.glb", "x.obj", "x.ply", "x.html", "x.json"]


@pytest.mark.parametrize("name", FILES)
def test_a_folder_in_the_files_place_is_refused(tmp_path: Path, name: str) -> None:
    (tmp_path / name).mkdir()
    with pytest.raises(ConfigError, match=f"{name}: is a folder; name a file, such as .*NAME"):
        ibrpipe.export(tmp_path / "never read", tmp_path / name)


@pytest.mark.parametrize(("name", "form"), [*((name, None) for name in FILES), ("d", "deep-exr"), ("d", "colmap")])
def test_a_file_in_the_folders_place_is_told(tmp_path: Path, name: str, form: str | None) -> None:
    (tmp_path / "file").write_text("x")
    with pytest.raises(ResourceError, match=r"cannot write: .*file is a file, not a folder; name another place"):
        ibrpipe.export(tmp_path / "never read", tmp_path / "file" / name, form)
    assert (tmp_path / "file").read_text() == "x"


@pytest.mark.parametrize("form", ["deep-exr", "colmap"])
def test_a_file_or_the_folder_of_something_else_is_no_target(tmp_path: Path, form: str) -> None:
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "mine").write_text("x")
    with pytest.raises(ConfigError, match="mine: is a file; name a folder"):
        ibrpipe.export(tmp_path / "never read", tmp_path / "full" / "mine", form)
    with pytest.raises(ConfigError, match=r"full: holds something that is no .*; name another folder"):
        ibrpipe.export(tmp_path / "never read", tmp_path / "full", form)
    assert [each.name for each in (tmp_path / "full").iterdir()] == ["mine"]


def test_a_place_without_permission_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "access", lambda path, mode: Path(path) != tmp_path)
    for check in (check_file, lambda target: check_folder(target, "mark", "asset")):
        with pytest.raises(ResourceError, match=r"no permission to write in .*; name another place"):
            check(tmp_path / "new" / "x")


def test_targets_that_are_free_pass(tmp_path: Path) -> None:
    (tmp_path / "old.glb").write_text("x")
    for target in (tmp_path / "old.glb", tmp_path / "a" / "b" / "new.glb"):
        check_file(target)
    for target in (tmp_path / "a" / "new", tmp_path / "empty"):
        check_folder(target, "mark", "asset")
    (tmp_path / "earlier").mkdir()
    (tmp_path / "earlier" / "mark").write_text("x")
    check_folder(tmp_path / "earlier", "mark", "asset")
    assert sorted(each.name for each in tmp_path.iterdir()) == ["earlier", "old.glb"]


def test_a_run_gives_its_finished_asset_or_says_that_it_has_none_yet(tmp_path: Path) -> None:
    run = tmp_path / "vase"
    run.mkdir()
    assert asset_folder(run) == run
    (run / "run.json").write_text("{}")
    with pytest.raises(MissingFileError, match=r"this run has made no asset yet; go on with ibrpipe run and --out"):
        ibrpipe.export(run, tmp_path / "x.glb")
    for place in (UNCOMPRESSED, FINISHED):
        ibrpipe.write_asset(make_asset("matt"), run / place)
        assert asset_folder(run) == run / place
        assert asset_folder(run / place) == run / place
        assert name_of(run / place) == "vase"
    assert name_of(run) == "vase"
