"""The whole pipeline by the command line on a tiny synthetic capture: what it writes, skips, redoes, and keeps."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import yaml
from click.testing import CliRunner, Result

import ibrpipe
from ibrpipe.cli.main import cli
from ibrpipe.cli.schema import models
from ibrpipe.evaluation.metrics import read_metrics
from ibrpipe.io.manifest import read_manifest
from ibrpipe.stages.registry import load_stages, registered

FAST = ["plan.samples=2000", "plan.residuals=always", "plan.k=0.125", "render.repeats=1", "evaluate.timing_width=64"]
FAST += ["evaluate.timing_repeats=1", "evaluate.timing_views=1", "evaluate.report_views=1"]
CHANGES = dict(change.split("=") for change in FAST)
SETTINGS = [word for change in FAST for word in ("--set", change)]


def run(out: Path, *args: object) -> Result:
    return CliRunner().invoke(cli, ["run", "mesh", "--out", str(out), *SETTINGS, *map(str, args)])


def started(result: Result) -> list[str]:
    return [line.split(":")[0] for line in result.stderr.splitlines() if ": starts (" in line]


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory, tiny_glossy: Path) -> Path:
    out = tmp_path_factory.mktemp("run") / "out"
    result = run(out, "--capture", tiny_glossy, "--workers", 2)
    assert result.exit_code == 0, result.output
    assert started(result) == list(registered())
    assert f"report: {out / 'report/report.html'}" in result.stdout
    return out


@pytest.fixture
def copy(finished: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(finished, tmp_path / "out"))


DOCUMENTS = {
    "asset": "asset/asset.json",
    "audit": "ingest/audit.json",
    "calibration": "calibrate/calibration.json",
    "compression": "asset/compression.json",
    "frames": "render/frames.json",
    "geometry": "geometry/geometry.json",
    "layers": "layers/layers.json",
    "metrics": "report/metrics.json",
    "photometry": "photometry/photometry.json",
    "plan": "plan/plan.json",
    "residuals": "residuals/residuals.json",
    "run": "run.json",
    "views": "photometry/views.json",
}


@pytest.mark.parametrize("name", DOCUMENTS)
def test_files_are_what_their_schemas_say(finished: Path, name: str) -> None:
    models()[name].model_validate_json((finished / DOCUMENTS[name]).read_bytes())


def test_every_artifact_lies_where_its_stage_says(finished: Path) -> None:
    artifacts = [(stage.path_of(made), made) for stage in load_stages() for made in stage.outputs.artifacts()]
    assert {path for path, made in artifacts if made.document} == {
        *DOCUMENTS.values(),
        "assembled/asset.json",
        "ingest/views.json",
    } - {"run.json"}
    lacking = {path for path, _ in artifacts if not (finished / path).exists()}
    assert lacking == {
        "calibrate/sparse/0",
        "ingest/points.npz",
        "geometry/dense",
        "plan/frusta.yaml",
        "plan/sides.npz",
    }
    assert lacking <= {path for path, made in artifacts if made.optional}


def test_metrics_hold_every_stage_and_baseline(finished: Path) -> None:
    metrics = read_metrics(finished / "report/metrics.json")
    assert set(metrics.baselines) == {"diffuse", "ulr", "mesh"}
    assert set(metrics.seconds) == set(registered())
    assert all(seconds > 0 for seconds in metrics.seconds.values())


def test_nothing_is_left_beside_the_results(finished: Path) -> None:
    places = {stage.folder for stage in load_stages()} | {"run.json", ".hashes.json"}
    assert {path.name for path in finished.iterdir()} == places


def test_second_run_skips_all_and_is_quick(copy: Path) -> None:
    before = {path: path.stat().st_mtime_ns for path in copy.rglob("*") if path.is_file()}
    result = run(copy)
    assert result.exit_code == 0, result.output
    assert started(result) == []
    changed = [path.name for path, stamp in before.items() if path.stat().st_mtime_ns != stamp]
    assert set(changed) <= {"run.json", ".hashes.json"}


def test_the_same_run_from_python_finds_all_done(copy: Path) -> None:
    done = ibrpipe.run(out=copy, pipeline="mesh", settings={key: yaml.safe_load(text) for key, text in CHANGES.items()})
    assert list(done.seconds) == list(registered())
    assert done.report == copy / "report/report.html"
    assert done.scores == done.metrics.mean
    assert done.scores.psnr is not None
    assert len(done.asset.textures) > 0
    kept = read_manifest(copy / "layers")
    assert kept is not None
    assert done.seconds["layers"] == kept.seconds  # of the first run: nothing was done anew


def test_a_changed_setting_runs_only_what_depends_on_it(copy: Path) -> None:
    result = run(copy, "--set", "render.width=48", "--until", "render")
    assert started(result) == ["render"]
    assert "render: starts (settings changed: width), stage " in result.stderr


def test_single_stage_writes_the_same_as_the_run(finished: Path, copy: Path) -> None:
    shutil.rmtree(copy / "layers")
    result = CliRunner().invoke(cli, ["layers", "--out", str(copy), "--workers", "1"])
    assert result.exit_code == 0, result.output
    assert digests(copy / "layers") == digests(finished / "layers")
    assert started(run(copy)) == []


def test_no_byte_depends_on_the_number_of_workers(finished: Path, tmp_path: Path, tiny_glossy: Path) -> None:
    result = run(tmp_path / "one", "--capture", tiny_glossy, "--workers", 1, "--until", "compress")
    assert result.exit_code == 0, result.output
    for stage in ("calibrate", "ingest", "geometry", "photometry", "plan", "layers", "residuals", "assembled", "asset"):
        assert digests(tmp_path / "one" / stage) == digests(finished / stage), stage


def digests(folder: Path) -> dict[str, str]:
    """Return the hashes of all files but manifests, which tell times."""
    files = (path for path in folder.rglob("*") if path.is_file() and path.name != "manifest.json")
    return {str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


@pytest.mark.skipif(sys.platform == "win32", reason="signals")
@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143), (signal.SIGKILL, -9)])
def test_a_stopped_run_goes_on(copy: Path, number: signal.Signals, code: int) -> None:
    command = [sys.executable, "-m", "ibrpipe", "run", "mesh", "--out", str(copy), *SETTINGS, "--set", "layers.bins=64"]
    child = subprocess.Popen(
        command,
        stderr=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        text=True,
        env=os.environ,
        # a shell's job in the background ignores Ctrl-C, and so would its children
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )
    assert child.stderr is not None
    while "layers: starts" not in (line := child.stderr.readline()):
        assert line
    while not (copy / ".layers.partial").exists():
        time.sleep(0.001)
    child.send_signal(number)
    rest = child.communicate(timeout=60)[1]
    assert child.returncode == code
    if number is signal.SIGINT:
        assert rest.splitlines()[-1].startswith("interrupted; finished stages are kept")
        assert "Traceback" not in rest
    if number is not signal.SIGKILL:
        assert not (copy / ".layers.partial").exists()
    assert json.loads((copy / "layers/manifest.json").read_text())["config"]["bins"] == 128
    result = run(copy, "--set", "layers.bins=64", "--until", "layers")
    assert result.exit_code == 0, result.output
    assert started(result) == ["layers"]
    assert not list(copy.glob(".layers.*"))


def test_inspect_reads_all_of_it(finished: Path, tiny_glossy: Path) -> None:
    for path in (tiny_glossy, finished, finished / "asset", finished / "ingest/views.json"):
        plain = CliRunner().invoke(cli, ["inspect", str(path)])
        assert plain.exit_code == 0, plain.output
        figures = CliRunner().invoke(cli, ["inspect", str(path), "--json"])
        assert json.loads(figures.stdout)["kind"] in ("capture", "run", "asset", "views")


def test_inspect_reads_a_run_of_one_stage_and_the_folder_of_a_stage(finished: Path, tmp_path: Path) -> None:
    shutil.copytree(finished / "plan", tmp_path / "plan")
    for path, kind in ((tmp_path, "run"), (tmp_path / "plan", "stage"), (finished / "layers", "stage")):
        result = CliRunner().invoke(cli, ["inspect", str(path), "--json"])
        assert result.exit_code == 0, result.output
        facts = json.loads(result.stdout)
        assert facts["kind"] == kind
        assert (facts["stages"]["plan"] if kind == "run" else facts)["bytes"] > 0


def test_a_capture_that_is_not_there_is_told_as_such(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for what, advice in (
        ("photos-of-vase", "there is no such folder of photos, video, or pipeline"),
        ("mehs", '"mesh"'),
    ):
        result = CliRunner().invoke(cli, ["run", what, "--out", "out"])
        assert result.exit_code == 1
        assert result.stderr.startswith(f"error: {what}: ")
        assert advice in result.stderr
        assert not (tmp_path / "out").exists()
