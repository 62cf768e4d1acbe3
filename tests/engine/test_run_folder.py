"""Stage folders that are replaced whole: files of others stay, and what a killed run left is put right."""

from __future__ import annotations

from pathlib import Path

import pytest

from ibrpipe.engine.run_folder import whole_folder
from ibrpipe.io.manifest import Manifest, write_manifest


def ours(files: dict[str, int]) -> Manifest:
    return Manifest(
        stage="plan", key="", config={}, inputs={}, upstream={}, code="", versions={}, files=files, seconds=0.0,
        peak_memory_bytes=None,
    )  # fmt: skip


def test_a_file_of_others_with_the_name_of_a_new_one_stays_beside_it(tmp_path: Path) -> None:
    target = tmp_path / "a"
    with whole_folder(target) as folder:
        write_manifest(folder, ours({}))
    (target / "plan.json").write_text("mine")
    for _ in range(2):
        with whole_folder(target) as folder:
            (folder / "plan.json").write_text("new")
            write_manifest(folder, ours({"plan.json": 3}))
    assert {path.name: path.read_text() for path in target.glob("plan*")} == {
        "plan.json": "new",
        "plan.json.kept": "mine",
    }


def test_files_of_others_outlive_a_kill_between_two_renames(tmp_path: Path) -> None:
    for name, files in ((".a.old", {"old.txt": "old", "mine.txt": "mine"}), ("a", {"new.txt": "new"})):
        (tmp_path / name).mkdir()
        for file, text in files.items():
            (tmp_path / name / file).write_text(text)
    write_manifest(tmp_path / ".a.old", ours({"old.txt": 3}))
    write_manifest(tmp_path / "a", ours({"new.txt": 3}))
    with pytest.raises(ZeroDivisionError), whole_folder(tmp_path / "a"):
        1 / 0
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a"]
    assert sorted(path.name for path in (tmp_path / "a").iterdir()) == ["manifest.json", "mine.txt", "new.txt"]


def test_stale_folders_are_cleared_and_an_old_result_is_put_back(tmp_path: Path) -> None:
    (tmp_path / ".a.partial").mkdir()
    (tmp_path / ".a.partial/half.txt").write_text("half")
    (tmp_path / ".a.old").mkdir()
    (tmp_path / ".a.old/whole.txt").write_text("whole")
    with pytest.raises(FileNotFoundError), whole_folder(tmp_path / "a") as folder:
        (folder / "half.txt").rename(folder / "whole.txt")
    assert (tmp_path / "a/whole.txt").read_text() == "whole"
    assert [path.name for path in tmp_path.iterdir()] == ["a"]
