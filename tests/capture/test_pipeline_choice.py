"""The pipeline follows what a capture folder holds."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from click.testing import CliRunner

from ibrpipe.capture.pipeline_choice import choose_pipeline
from ibrpipe.cli.main import cli
from ibrpipe.errors import MissingFileError
from ibrpipe.io.untrusted.inside import shortened


@pytest.fixture
def capture(tiny_ball: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(tiny_ball, tmp_path / "capture"))


def without_mesh(capture: Path) -> None:
    for mesh in capture.glob("mesh.*"):
        mesh.unlink()


def without_cameras(capture: Path) -> None:
    shutil.rmtree(capture / "sparse", ignore_errors=True)
    (capture / "transforms.json").unlink(missing_ok=True)


def test_cameras_and_a_mesh(capture: Path) -> None:
    name, why = choose_pipeline(capture)
    assert name == "mesh"
    assert "cameras and mesh." in why


def test_cameras_alone(capture: Path) -> None:
    without_mesh(capture)
    assert choose_pipeline(capture) == ("calibrated", "cameras, no mesh")


def test_photos_alone(capture: Path) -> None:
    without_mesh(capture)
    without_cameras(capture)
    assert choose_pipeline(capture) == ("photos", "no cameras")


def test_no_folder(tmp_path: Path) -> None:
    with pytest.raises(MissingFileError, match=r"nowhere: is no folder; give a capture folder"):
        choose_pipeline(tmp_path / "nowhere")


def test_the_command_says_what_it_chose_and_runs_it(capture: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    result = CliRunner().invoke(cli, ["run", str(capture), "--out", str(out), "--until", "ingest"])
    assert result.exit_code == 0, result.output
    assert "pipeline mesh" in result.stderr
    assert '"pipeline": "mesh"' in (out / "run.json").read_text()
    assert (out / "ingest").is_dir()


def test_a_folder_named_like_a_pipeline(capture: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    capture.rename("photos")
    result = CliRunner().invoke(cli, ["run", "./photos", "--out", "out", "--until", "ingest"])
    assert result.exit_code == 0, result.output
    assert "pipeline mesh" in result.stderr


@pytest.mark.parametrize(
    ("wrong", "line"),
    [
        ("nowhere", "there is no capture folder {}; give the right one with --capture"),
        ("file", "{}: is neither a capture folder nor a video; give one of them"),
        ("film.mp4", "there is no capture folder {}; give the right one with --capture"),
    ],
)
def test_a_wrong_capture_leaves_no_run_folder(tmp_path: Path, wrong: str, line: str) -> None:
    (tmp_path / "file").write_text("x")
    out = tmp_path / "out"
    result = CliRunner().invoke(cli, ["run", "mesh", "--capture", str(tmp_path / wrong), "--out", str(out)])
    assert result.exit_code == 1
    named = str(tmp_path / wrong)
    assert any(line.format(told) in result.stderr for told in (named, shortened(named)))  # long paths are cut short
    assert not out.exists()
