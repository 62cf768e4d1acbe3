"""Every command: help, example, exit codes; stage commands on a tiny fake stage."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import click
import numpy as np
import pytest
from click.testing import CliRunner, Result
from pydantic import Field, model_validator

from ibrpipe.cli import boundary
from ibrpipe.cli.main import cli, sections
from ibrpipe.cli.stage import stage_command
from ibrpipe.config import StageConfig
from ibrpipe.engine.stage import Stage, StageOutputs
from ibrpipe.errors import CaptureError
from ibrpipe.io.manifest import read_manifest
from ibrpipe.progress import track
from ibrpipe.stages.registry import load_stage, registered

NAMES = [name for section in sections().values() for name in section]


def call(*args: object, command: click.Command = cli) -> Result:
    return CliRunner().invoke(command, [str(arg) for arg in args])


@pytest.mark.parametrize("name", NAMES)
def test_help_has_summary_options_and_example(name: str) -> None:
    result = call(name, "--help")
    assert result.exit_code == 0, result.output
    assert "Example:\n" in result.output
    assert f"ibrpipe {name}" in result.output.split("Example:")[1]
    context = click.Context(cli)
    command = cli.get_command(context, name)
    assert command is not None
    assert command.name == name
    for param in command.params:
        if isinstance(param, click.Option):
            assert param.help, f"{name} --{param.name} has no help"


@pytest.mark.parametrize("name", registered())
def test_example_of_a_stage_is_a_valid_call(name: str) -> None:
    stage = load_stage(name)
    words = stage.example.split()
    assert words[:2] == ["ibrpipe", name]
    context = stage_command(stage).make_context(name, words[2:])
    assert context.params["out"]


def test_group_help_imports_nothing_slow_and_lists_every_command() -> None:
    code = "import sys; from ibrpipe.cli.main import cli; cli(['--help'], standalone_mode=False); print(*sys.modules)"
    output = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    help_text, modules = output.rsplit("\n", 2)[0], output.rsplit("\n", 2)[1].split()
    assert all(f"  {name} " in help_text for name in NAMES)
    assert {"numpy", "numba", "pydantic", "rich", "yaml", "open3d", "cv2", "pycolmap", "OpenImageIO"} & set(
        modules
    ) == set()


def test_stage_summaries_are_the_ones_listed() -> None:
    for name in registered():
        assert load_stage(name).name == name


@pytest.mark.parametrize(
    ("args", "message"),
    [
        (["ingset"], 'did you mean "ingest"'),
        (["run"], "Missing argument 'CAPTURE|PIPELINE'"),
        (["run", "mesh", "--from", "plann"], "is not one of"),
        (["run", "mesh", "--set", "ingest"], "expected stage.key=value"),
        (["run", "mesh", "--set", "ingest.exposur=csv"], 'did you mean "exposure"'),
        (["run", "mesh", "--set", "ingst.exposure=csv"], 'did you mean "ingest"'),
        (["run", "mesh", "--workers", "-1"], "not in the range"),
        (["synth", "glosy", "x"], "is not one of"),
        (["ingest"], "Missing argument 'CAPTURE'"),
        (["schema", "pipelin"], 'did you mean "pipeline"'),
        (["demo", "--no-such"], "No such option"),
    ],
)
def test_wrong_use_is_exit_code_2(args: list[str], message: str) -> None:
    result = call(*args)
    assert result.exit_code == 2, result.output
    assert message in result.stderr
    assert result.stdout == ""


class Inner(StageConfig):
    depth: int = 1


class FakeConfig(StageConfig):
    bins: int = Field(64, ge=8, le=256, description="Histogram bins")
    share: float = Field(0.5, gt=0, lt=1, description="Share")
    mode: Literal["median", "mean"] = Field("median", description="What is taken")
    loud: bool = Field(False, description="Shout")
    label: str | None = Field(None, description="Label")
    names: tuple[str, ...] = Field(("a",), description="Names")
    boxes: tuple[Inner, ...] = Field((), description="Boxes")
    corner: tuple[float, float] = Field((0.0, 1.0), description="Corner")

    @model_validator(mode="after")
    def _agree(self) -> FakeConfig:
        if self.loud and self.label is None:
            raise ValueError("loud needs a label")
        return self


@dataclass(frozen=True)
class FakeInputs:
    capture: Path
    views: Path
    seed: int
    out: Path
    mesh: Path | None = None


def fake_run(inputs: FakeInputs, config: FakeConfig) -> None:
    if config.label == "broken":
        raise CaptureError("the capture is\nbroken; mend it")
    if config.label == "stop":
        raise KeyboardInterrupt
    if config.label == "full":
        raise OSError(28, "No space left on device", "/big/file")
    if config.label == "rights":
        raise PermissionError(13, "Permission denied", "/etc/file")
    if config.label == "memory":
        raise MemoryError("Unable to allocate 90 GiB")
    if config.label == "bug":
        raise RuntimeError("a bug")
    for _ in track(range(100), "counting"):
        pass
    (inputs.out / "text.txt").write_text(f"{config.bins} {inputs.seed} {inputs.mesh is None}")


FAKE = Stage("fake", "A fake stage.", FakeInputs, StageOutputs, FakeConfig, fake_run, "ibrpipe fake c --out o")


@pytest.fixture
def run_folder(tmp_path: Path) -> Path:
    (tmp_path / "capture").mkdir()
    (tmp_path / "run/photometry").mkdir(parents=True)
    (tmp_path / "run/photometry/views.json").write_text("{}")
    return tmp_path


def fake(folder: Path, *args: object) -> Result:
    group = click.Group(commands={"fake": stage_command(FAKE)})

    def invoke(ctx: click.Context) -> object:
        with boundary.one_line():
            return click.Group.invoke(group, ctx)

    group.invoke = invoke  # type: ignore[method-assign]
    return call("fake", folder / "capture", "--out", folder / "run", *args, command=group)


def test_an_array_that_the_disk_cuts_short_is_one_line(tmp_path: Path) -> None:
    resource = pytest.importorskip("resource")
    old = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (5000, old[1]))
    try:
        with pytest.raises(boundary.Failure, match="no space left on the disk"), boundary.one_line():
            np.save(tmp_path / "a.npy", np.zeros(10_000, np.float32))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, old)
        signal.signal(signal.SIGXFSZ, handler)


def test_stage_command_runs_and_prints_json(run_folder: Path) -> None:
    result = fake(run_folder, "--bins", 32, "--seed", 5, "--names", "x", "--names", "y", "--corner", "[2, 3]", "--json")
    assert result.exit_code == 0, result.output
    assert (run_folder / "run/fake/text.txt").read_text() == "32 5 True"
    printed = json.loads(result.stdout)
    assert printed["config"]["names"] == ["x", "y"]
    assert printed["config"]["corner"] == [2.0, 3.0]
    assert read_manifest(run_folder / "run/fake").key == printed["key"]  # type: ignore[union-attr]
    assert "fake: done in" in result.stderr
    assert len(result.stderr.splitlines()) < 22


def test_stage_command_takes_explicit_paths(run_folder: Path) -> None:
    mesh = run_folder / "mesh.ply"
    mesh.write_text("ply")
    assert fake(run_folder, "--mesh", mesh).exit_code == 0
    assert (run_folder / "run/fake/text.txt").read_text() == "64 0 False"
    result = fake(run_folder, "--mesh", run_folder / "none.ply")
    assert result.exit_code == 1
    assert "none.ply does not exist" in result.stderr
    (run_folder / "run/photometry/views.json").rename(run_folder / "other.json")
    assert "run the earlier stages first or give --views" in fake(run_folder).stderr
    assert fake(run_folder, "--views", run_folder / "other.json").exit_code == 0


def test_help_shows_bounds_defaults_and_choices() -> None:
    text = " ".join(call("--help", command=stage_command(FAKE)).output.split())
    for part in (
        "8<=x<=256",
        "default: 64",
        "0<x<1",
        "[median|mean]",
        "--loud / --no-loud",
        "[0.0, 1.0]",
        "--mesh",
        "photometry/views.json in the run folder",
    ):
        assert part in text


@pytest.mark.parametrize(
    ("args", "message"),
    [
        (["--bins", "7"], "8<=x<=256"),
        (["--share", "1"], "0<x<1"),
        (["--boxes", "[{dept: 1}]"], "boxes"),
        (["--boxes", "[1"], "not valid YAML"),
        (["--corner", "[1]"], "corner"),
        (["--loud"], "loud needs a label"),
    ],
)
def test_wrong_settings_are_exit_code_2(run_folder: Path, args: list[str], message: str) -> None:
    result = fake(run_folder, *args)
    assert result.exit_code == 2
    assert message in result.stderr


@pytest.mark.parametrize(
    ("label", "code", "line"),
    [
        ("broken", 1, "error: the capture is broken; mend it"),
        ("full", 1, "error: no space left on the disk at /big/file; make room and run the same command again"),
        ("rights", 1, "error: no permission to use the file or folder at /etc/file (Permission denied); "),
        ("memory", 1, "error: not enough memory (Unable to allocate 90 GiB); use smaller photos or settings"),
        ("stop", 130, "interrupted; finished stages are kept, run the same command again to go on"),
    ],
)
def test_a_failure_is_one_line_and_leaves_nothing(run_folder: Path, label: str, code: int, line: str) -> None:
    result = fake(run_folder, "--label", label)
    assert result.exit_code == code
    assert result.stderr.splitlines()[-1].startswith(line)
    assert len(result.stderr.splitlines()) == 2
    assert sorted(path.name for path in (run_folder / "run").iterdir()) == ["photometry"]


def test_a_bug_is_not_hidden(run_folder: Path) -> None:
    result = fake(run_folder, "--label", "bug")
    assert isinstance(result.exception, RuntimeError)


def test_inspect_of_a_binary_file_is_one_short_line(tmp_path: Path) -> None:
    path = tmp_path / "photo.bin"
    path.write_bytes(bytes(range(256)) * 4000)
    for name in (path, path.rename(tmp_path / "photo.json")):
        path.write_bytes(bytes(range(256)) * 4000)
        result = CliRunner().invoke(cli, ["inspect", str(name)])
        assert result.exit_code == 1
        assert len(result.output) < 600
        assert name.name in result.output
