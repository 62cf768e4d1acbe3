"""The runner on three tiny stages: read words, upper-case them, count them."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import textwrap
from dataclasses import dataclass
from pathlib import Path

import pytest
from pydantic import Field

from ibrpipe.config import StageConfig
from ibrpipe.engine.pipeline_file import Pipeline
from ibrpipe.engine.run_folder import only_run, whole_folder
from ibrpipe.engine.runner import Event, Run, run_pipeline
from ibrpipe.engine.stage import Stage, StageOutputs, artifact
from ibrpipe.errors import CaptureError, ConfigError, MissingFileError, ResourceError
from ibrpipe.io.manifest import Hasher, read_manifest


class ReadConfig(StageConfig):
    suffix: str = Field("", description="Text put behind every word")


class ShoutConfig(StageConfig):
    times: int = Field(1, ge=1, le=9, description="Number of exclamation marks")


class CountConfig(StageConfig):
    dictionary: str = Field("", description="Optional file of words to leave out")


@dataclass(frozen=True)
class ReadInputs:
    capture: Path
    seed: int
    out: Path


@dataclass(frozen=True)
class ShoutInputs:
    views: Path
    out: Path


@dataclass(frozen=True)
class CountInputs:
    plan: Path
    out: Path
    mesh: Path | None = None


@dataclass(frozen=True)
class ReadOutputs(StageOutputs):
    views: Path = artifact("views.json", "Words.")


@dataclass(frozen=True)
class ShoutOutputs(StageOutputs):
    plan: Path = artifact("plan.json", "Words, louder.")


CALLS: list[str] = []


def read(inputs: ReadInputs, config: ReadConfig) -> None:
    CALLS.append("ingest")
    words = (inputs.capture / "words.txt").read_text().split()
    if not words:
        raise CaptureError("no words")
    views = [word + config.suffix for word in words] + [str(inputs.seed)]
    (inputs.out / "views.json").write_text(json.dumps(views))


def shout(inputs: ShoutInputs, config: ShoutConfig) -> None:
    CALLS.append("plan")
    (inputs.out / "half.txt").write_text("half")
    words = json.loads(inputs.views.read_text())
    if "stop" in words:
        raise KeyboardInterrupt
    (inputs.out / "plan.json").write_text(" ".join(word.upper() + "!" * config.times for word in words))


def count(inputs: CountInputs, config: CountConfig) -> None:
    CALLS.append("layers")
    (inputs.out / "count.txt").write_text(str(len(inputs.plan.read_text().split())))


STAGES = (
    Stage("ingest", "Read.", ReadInputs, ReadOutputs, ReadConfig, read, "ibrpipe ingest capture --out out"),
    Stage("plan", "Shout.", ShoutInputs, ShoutOutputs, ShoutConfig, shout, "ibrpipe plan --out out"),
    Stage(
        "layers", "Count.", CountInputs, StageOutputs, CountConfig, count, "ibrpipe layers --out out", folder="counts"
    ),
)


@pytest.fixture
def capture(tmp_path: Path) -> Path:
    folder = tmp_path / "capture"
    folder.mkdir()
    (folder / "words.txt").write_text("relief texture")
    age(folder / "words.txt")
    return folder


@pytest.fixture(autouse=True)
def _no_calls() -> None:
    CALLS.clear()


def age(path: Path) -> None:
    """Make a file old enough for its hash to be remembered."""
    os.utime(path, ns=(10**18, 10**18))


def pipeline(seed: int = 0, **settings: StageConfig) -> Pipeline:
    configs = {"ingest": ReadConfig(), "plan": ShoutConfig(), "layers": CountConfig(), **settings}
    return Pipeline("test", seed, configs)


def go(out: Path, capture: Path | None = None, loaded: Pipeline | None = None, **options: object) -> list[Event]:
    events: list[Event] = []
    CALLS.clear()
    run_pipeline(Run(loaded or pipeline(), out, capture, **options), STAGES, events.append)  # type: ignore[arg-type]
    return events


def test_runs_in_order_and_records(tmp_path: Path, capture: Path) -> None:
    go(tmp_path / "out", capture)
    assert CALLS == ["ingest", "plan", "layers"]
    assert (tmp_path / "out/counts/count.txt").read_text() == "3"
    manifest = read_manifest(tmp_path / "out/plan")
    assert manifest is not None
    assert manifest.config == {"times": 1}
    assert manifest.files == {"half.txt": 4, "plan.json": len("RELIEF! TEXTURE! 0!")}
    assert set(manifest.upstream) == {"ingest"}
    assert manifest.upstream["ingest"] == read_manifest(tmp_path / "out/ingest").key  # type: ignore[union-attr]
    assert "numpy" in manifest.versions
    assert manifest.seconds < 5
    assert manifest.peak_memory_bytes is None or 1e6 < manifest.peak_memory_bytes < 1e11


def test_skips_what_is_up_to_date(tmp_path: Path, capture: Path) -> None:
    go(tmp_path / "out", capture)
    events = go(tmp_path / "out", capture)
    assert CALLS == []
    assert [event.kind for event in events] == ["skipped"] * 3


@pytest.mark.parametrize(
    ("settings", "expected", "why"),
    [
        ({"ingest": ReadConfig(suffix="s")}, ["ingest", "plan", "layers"], "settings changed: suffix"),
        ({"plan": ShoutConfig(times=3)}, ["plan", "layers"], "settings changed: times"),
        ({"seed": 7}, ["ingest", "plan", "layers"], "inputs changed: seed"),
    ],
)
def test_a_change_reruns_what_depends_on_it(
    tmp_path: Path, capture: Path, settings: dict[str, object], expected: list[str], why: str
) -> None:
    go(tmp_path / "out", capture)
    events = go(tmp_path / "out", capture, pipeline(**settings))  # type: ignore[arg-type]
    assert expected == CALLS
    assert next(event.text for event in events if event.kind == "starts") == why


def test_a_changed_photo_reruns(tmp_path: Path, capture: Path) -> None:
    go(tmp_path / "out", capture)
    (capture / "words.txt").write_text("relief textured")
    events = go(tmp_path / "out", capture)
    assert CALLS == ["ingest", "plan", "layers"]
    assert events[0].text == "inputs changed: capture"


def test_an_added_photo_reruns_and_an_output_inside_the_capture_does_not(capture: Path) -> None:
    out = capture / "out"
    go(out, capture)
    go(capture / "other", capture)
    go(out, capture)
    assert CALLS == []
    (capture / "more.txt").write_text("x")
    go(out, capture)
    assert CALLS == ["ingest", "plan", "layers"]


def test_same_size_and_time_is_not_hashed_again_but_any_touch_is(tmp_path: Path) -> None:
    path, memory = tmp_path / "a.txt", tmp_path / "memory.json"
    path.write_text("one")
    age(path)
    hasher = Hasher(memory)
    first = hasher.file(path)
    hasher.remember()
    path.write_text("two")
    assert Hasher(memory).file(path) != first
    age(path)
    assert Hasher(memory).file(path) == first


def test_a_file_written_a_moment_ago_is_not_remembered(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_text("one")
    stamp = path.stat().st_mtime_ns
    hasher = Hasher()
    first = hasher.file(path)
    path.write_text("two")
    os.utime(path, ns=(stamp, stamp))
    assert hasher.file(path) != first


def test_the_memory_file_is_there_after_the_quickest_of_runs(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text("one")
    hasher = Hasher(tmp_path / "memory.json")
    hasher.file(tmp_path / "a.txt")
    hasher.remember()
    assert json.loads((tmp_path / "memory.json").read_text()) == {}


def test_damaged_memory_of_hashes_is_ignored(tmp_path: Path, capture: Path) -> None:
    go(tmp_path / "out", capture)
    (tmp_path / "out/.hashes.json").write_text('{"a": 1')
    go(tmp_path / "out", capture)
    assert CALLS == []


def test_lost_or_edited_output_is_made_again(tmp_path: Path, capture: Path) -> None:
    go(tmp_path / "out", capture)
    (tmp_path / "out/ingest/views.json").unlink()
    events = go(tmp_path / "out", capture)
    assert events[0].text == "output changed or lost: views.json"
    assert CALLS == ["ingest"]
    (tmp_path / "out/plan/plan.json").write_text("RELIEF! TEXTURE! 1!")
    go(tmp_path / "out", capture)
    assert CALLS == ["layers"]


def test_file_named_in_settings_counts(tmp_path: Path, capture: Path) -> None:
    words = tmp_path / "dictionary.txt"
    words.write_text("a")
    loaded = pipeline(layers=CountConfig(dictionary=str(words)))
    go(tmp_path / "out", capture, loaded)
    words.write_text("b")
    events = go(tmp_path / "out", capture, loaded)
    assert CALLS == ["layers"]
    assert events[2].text == "inputs changed: dictionary"


def test_unreadable_manifest_reruns(tmp_path: Path, capture: Path) -> None:
    go(tmp_path / "out", capture)
    (tmp_path / "out/plan/manifest.json").write_text("{")
    go(tmp_path / "out", capture)
    assert CALLS == ["plan"]


def test_from_until_force(tmp_path: Path, capture: Path) -> None:
    out = tmp_path / "out"
    go(out, capture, last="plan")
    assert CALLS == ["ingest", "plan"]
    go(out, first="plan", force=True)
    assert CALLS == ["plan", "layers"]
    go(out, loaded=pipeline(ingest=ReadConfig(suffix="x")), first="plan")
    assert CALLS == []


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"first": "layers", "last": "plan"}, "--from layers comes after --until plan"),
        ({"first": "plann"}, 'did you mean "plan"'),
        ({"last": "xyz"}, "expected one of: ingest, plan, layers"),
    ],
)
def test_wrong_choice_of_stages(tmp_path: Path, capture: Path, options: dict[str, str], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        go(tmp_path / "out", capture, **options)


def test_capture_is_remembered_and_needed(tmp_path: Path, capture: Path) -> None:
    with pytest.raises(MissingFileError, match="--capture"):
        go(tmp_path / "out")
    with pytest.raises(MissingFileError, match="nowhere"):
        go(tmp_path / "out", tmp_path / "nowhere")
    go(tmp_path / "out", capture)
    go(tmp_path / "out", force=True)
    assert CALLS == ["ingest", "plan", "layers"]


def test_missing_earlier_result(tmp_path: Path, capture: Path) -> None:
    with pytest.raises(MissingFileError, match=r"layers needs .*plan\.json.*run the earlier stages"):
        go(tmp_path / "out", capture, first="layers")


def test_failure_keeps_earlier_results_and_leaves_nothing_half_written(tmp_path: Path, capture: Path) -> None:
    out = tmp_path / "out"
    go(out, capture)
    (capture / "words.txt").write_text("")
    with pytest.raises(CaptureError, match="no words"):
        go(out, capture)
    assert (out / "ingest/views.json").read_text() == '["relief", "texture", "0"]'
    assert not list(out.glob(".*.partial"))
    (capture / "words.txt").write_text("stop")
    with pytest.raises(KeyboardInterrupt):
        go(out, capture)
    assert (out / "plan/plan.json").read_text().startswith("RELIEF")
    assert not list(out.glob(".*.partial"))


def test_foreign_folder_is_not_overwritten(tmp_path: Path, capture: Path) -> None:
    (tmp_path / "out/ingest").mkdir(parents=True)
    (tmp_path / "out/ingest/thesis.txt").write_text("three years of work")
    with pytest.raises(ResourceError, match="did not write"):
        go(tmp_path / "out", capture)
    assert (tmp_path / "out/ingest/thesis.txt").read_text() == "three years of work"


def test_files_of_others_in_a_stage_folder_stay(tmp_path: Path, capture: Path) -> None:
    go(tmp_path / "out", capture)
    folder = tmp_path / "out/plan"
    (folder / "mine").mkdir()
    (folder / "mine/notes.txt").write_text("three years of work")
    (folder / "away").symlink_to(capture)
    changed = pipeline(plan=ShoutConfig(times=3))
    go(tmp_path / "out", loaded=changed)
    assert (folder / "plan.json").read_text().startswith("RELIEF!!!")
    assert (folder / "mine/notes.txt").read_text() == "three years of work"
    assert (folder / "away").is_symlink()
    assert (capture / "words.txt").is_file()
    assert sorted(read_manifest(folder).files) == ["half.txt", "plan.json"]
    go(tmp_path / "out", loaded=changed)
    assert CALLS == []
    (folder / "mine/notes.txt").unlink()
    go(tmp_path / "out", loaded=changed)
    assert CALLS == []  # they are no output that could be lost


def test_a_stage_folder_that_is_a_link_works_every_time(tmp_path: Path, capture: Path) -> None:
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "out").mkdir()
    (tmp_path / "out/plan").symlink_to(tmp_path / "elsewhere")
    for times in (1, 2, 3):
        go(tmp_path / "out", capture, pipeline(plan=ShoutConfig(times=times)))
        assert "plan" in CALLS
        assert (tmp_path / "out/plan").is_symlink()
        assert (tmp_path / "elsewhere/plan.json").read_text().startswith("RELIEF" + "!" * times + " ")
    assert not list(tmp_path.glob(".*"))


def test_two_runs_in_one_folder(tmp_path: Path, capture: Path) -> None:
    with only_run(tmp_path / "out"), pytest.raises(ResourceError, match="another ibrpipe works in"):
        go(tmp_path / "out", capture)


KILLED = """
    import sys, time
    from pathlib import Path
    from ibrpipe.engine.run_folder import only_run, whole_folder
    out = Path(sys.argv[1])
    with only_run(out), whole_folder(out / "layers") as folder:
        (folder / "half.txt").write_text("half")
        print("writing", flush=True)
        time.sleep(60)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="no SIGKILL on Windows")
def test_a_killed_run_leaves_no_lock_and_no_result(tmp_path: Path) -> None:
    command = [sys.executable, "-c", textwrap.dedent(KILLED), str(tmp_path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as child:
        assert child.stdout is not None
        assert child.stdout.readline() == b"writing\n"
        child.send_signal(signal.SIGKILL)
    assert not (tmp_path / "layers").exists()
    with only_run(tmp_path), whole_folder(tmp_path / "layers") as folder:
        assert list(folder.iterdir()) == []
        (folder / "whole.txt").write_text("whole")
    assert [path.name for path in (tmp_path / "layers").iterdir()] == ["whole.txt"]


def test_a_wrong_capture_leaves_no_run_folder_behind(tmp_path: Path, capture: Path) -> None:
    out = tmp_path / "out"
    for wrong in (tmp_path / "nowhere", capture / "words.txt"):
        with pytest.raises(MissingFileError, match="there is no capture folder"):
            go(out, wrong)
        assert not out.exists()
    (capture / "words.txt").write_text("")
    with pytest.raises(CaptureError, match="no words"):
        go(out, capture)
    assert not out.exists()
    out.mkdir()
    with pytest.raises(CaptureError, match="no words"):
        go(out, capture)
    assert out.is_dir()  # it was there before
