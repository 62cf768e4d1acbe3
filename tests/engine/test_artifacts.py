"""Inputs come from the latest earlier stage that makes them; a stage may replace what an earlier one has made."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path

import pytest
from pydantic import Field

from ibrpipe.config import StageConfig
from ibrpipe.engine.artifacts import needs, products, sources, wire
from ibrpipe.engine.order import in_order
from ibrpipe.engine.pipeline_file import Pipeline
from ibrpipe.engine.runner import Event, Run, run_pipeline
from ibrpipe.engine.stage import Artifact, Stage, StageOutputs, artifact
from ibrpipe.errors import ConfigError, MissingFileError
from ibrpipe.io.manifest import read_manifest


class Settings(StageConfig):
    text: str = Field("", description="What is put behind")


@dataclass(frozen=True)
class WriteInputs:
    capture: Path
    out: Path


@dataclass(frozen=True)
class WriteOutputs(StageOutputs):
    story: Path = artifact("story.txt", "A story.")
    notes: Path | None = artifact("notes.txt", "Notes to it.", optional=True)


@dataclass(frozen=True)
class EditInputs:
    story: Path
    out: Path


@dataclass(frozen=True)
class EditOutputs(StageOutputs):
    story: Path = artifact("better/story.txt", "The story, edited.")


@dataclass(frozen=True)
class PrintInputs:
    story: Path
    out: Path
    notes: Path | None = None
    cover: Path | None = None


@dataclass(frozen=True)
class PrintOutputs(StageOutputs):
    book: Path = artifact("", "The book.")


def write(inputs: WriteInputs, config: Settings) -> WriteOutputs:
    outputs = WriteOutputs.below(inputs.out)
    outputs.story.write_text((inputs.capture / "idea.txt").read_text() + config.text)
    return outputs.made()


def edit(inputs: EditInputs, config: Settings) -> EditOutputs:
    outputs = EditOutputs.below(inputs.out)
    outputs.story.parent.mkdir()
    outputs.story.write_text(inputs.story.read_text().upper() + config.text)
    return outputs


def print_(inputs: PrintInputs, config: Settings) -> PrintOutputs:
    (inputs.out / "book.txt").write_text(f"[{inputs.story.read_text()}]{config.text}")
    return PrintOutputs.below(inputs.out)


WRITE = Stage("write", "Write.", WriteInputs, WriteOutputs, Settings, write, "ibrpipe write c")
EDIT = Stage("edit", "Edit.", EditInputs, EditOutputs, Settings, edit, "ibrpipe edit")
PRINT = Stage("print", "Print.", PrintInputs, PrintOutputs, Settings, print_, "ibrpipe print", "printed")
SHORT, LONG = (WRITE, PRINT), (WRITE, EDIT, PRINT)


@pytest.fixture
def capture(tmp_path: Path) -> Path:
    (tmp_path / "capture").mkdir()
    (tmp_path / "capture/idea.txt").write_text("once")
    return tmp_path / "capture"


def go(out: Path, stages: tuple[Stage, ...], capture: Path | None = None, **texts: str) -> list[tuple[str, str, str]]:
    events: list[Event] = []
    configs: dict[str, StageConfig] = {stage.name: Settings(text=texts.get(stage.name, "")) for stage in stages}
    run_pipeline(Run(Pipeline("test", 0, configs), out, capture), stages, events.append)
    return [(event.stage, event.kind, event.text) for event in events]


def started(out: Path, stages: tuple[Stage, ...], capture: Path | None = None, **texts: str) -> list[str]:
    return [name for name, kind, _ in go(out, stages, capture, **texts) if kind == "starts"]


def test_outputs_state_paths_and_meaning() -> None:
    assert WriteOutputs.artifacts() == (
        Artifact("story", "story.txt", "A story."),
        Artifact("notes", "notes.txt", "Notes to it.", optional=True),
    )
    assert WriteOutputs.below(Path("a")) == WriteOutputs(story=Path("a/story.txt"), notes=Path("a/notes.txt"))
    assert PrintOutputs.below(Path("a")).book == Path("a")
    assert StageOutputs.artifacts() == ()
    assert WRITE.path_of(WriteOutputs.artifacts()[0]) == "write/story.txt"
    assert PRINT.path_of(PrintOutputs.artifacts()[0]) == "printed"


def test_optional_outputs_that_were_not_made_are_none(tmp_path: Path) -> None:
    outputs = WriteOutputs.below(tmp_path)
    assert outputs.made().notes is None
    assert outputs.made().story == tmp_path / "story.txt"
    (tmp_path / "notes.txt").touch()
    assert outputs.made() == outputs


def test_the_latest_producer_before_the_reader_counts() -> None:
    assert sources(PRINT, SHORT)["story"].path == "write/story.txt"
    assert sources(PRINT, LONG)["story"].path == "edit/better/story.txt"
    assert sources(PRINT, LONG)["notes"].path == "write/notes.txt"
    assert sources(EDIT, LONG)["story"].path == "write/story.txt"
    assert products(LONG)["story"].stage is EDIT
    assert (needs(WRITE, LONG), needs(EDIT, LONG), needs(PRINT, LONG)) == (("capture",), ("write",), ("write", "edit"))
    assert needs(PRINT, SHORT) == ("write",)


def test_a_replacing_stage_is_read_and_upstream_without_the_others_knowing(tmp_path: Path, capture: Path) -> None:
    out = tmp_path / "out"
    assert started(out, SHORT, capture) == ["write", "print"]
    assert (out / "printed/book.txt").read_text() == "[once]"
    assert started(out, LONG) == ["edit", "print"]
    assert (out / "printed/book.txt").read_text() == "[ONCE]"
    manifest = read_manifest(out / "printed")
    assert manifest is not None
    assert set(manifest.upstream) == {"write", "edit"}
    assert started(out, LONG) == []
    assert started(out, LONG, edit="!") == ["edit", "print"]
    assert (out / "printed/book.txt").read_text() == "[ONCE!]"
    assert started(out, SHORT) == ["print"]
    assert (out / "printed/book.txt").read_text() == "[once]"


def test_two_replacing_stages_follow_each_other(tmp_path: Path, capture: Path) -> None:
    again = dataclasses.replace(EDIT, name="again", folder="again")
    assert sources(again, (WRITE, EDIT, again, PRINT))["story"].path == "edit/better/story.txt"
    go(tmp_path / "out", (WRITE, EDIT, again, PRINT), capture, edit="?", again="!")
    assert (tmp_path / "out/printed/book.txt").read_text() == "[ONCE?!]"


def test_what_is_missing_is_told(tmp_path: Path) -> None:
    with pytest.raises(MissingFileError, match=r"print needs .*edit.better.story\.txt.*run the earlier stages first"):
        wire(PRINT, LONG, tmp_path, None, 0)
    with pytest.raises(ConfigError, match='print has an input "story" that nothing provides; known: capture, run'):
        wire(PRINT, (PRINT, WRITE), tmp_path, None, 0)


def test_order_follows_from_what_is_read_and_replaced() -> None:
    assert in_order((PRINT, WRITE)) == (WRITE, PRINT)
    assert in_order((WRITE, PRINT, EDIT)) == (WRITE, EDIT, PRINT)
    other = Stage("ghost", "Write, too.", WriteInputs, EditOutputs, Settings, write, "ibrpipe ghost c")
    assert in_order((WRITE, PRINT, other)) == (WRITE, other, PRINT)


def test_a_stage_that_looks_at_the_run_comes_last() -> None:
    @dataclass(frozen=True)
    class Inputs:
        story: Path
        run: Path
        out: Path

    last = Stage("last", "Look.", Inputs, StageOutputs, Settings, write, "ibrpipe last")
    assert in_order((WRITE, last, EDIT, PRINT)) == (WRITE, EDIT, PRINT, last)
    assert in_order((WRITE, EDIT, PRINT, last)) == (WRITE, EDIT, PRINT, last)


def test_an_impossible_order_is_told() -> None:
    @dataclass(frozen=True)
    class ChickenInputs:
        egg: Path
        out: Path

    @dataclass(frozen=True)
    class ChickenOutputs(StageOutputs):
        chicken: Path = artifact("chicken", "Lays eggs.")

    @dataclass(frozen=True)
    class EggInputs:
        out: Path
        chicken: Path | None = None

    @dataclass(frozen=True)
    class EggOutputs(StageOutputs):
        egg: Path = artifact("egg", "Becomes a chicken.")

    chicken = Stage("chicken", "", ChickenInputs, ChickenOutputs, Settings, write, "")
    egg = Stage("egg", "", EggInputs, EggOutputs, Settings, write, "")
    assert in_order((WRITE, egg)) == (egg, WRITE)
    with pytest.raises(ConfigError, match='stage chicken has an input "egg" that nothing provides'):
        in_order((WRITE, chicken))
    with pytest.raises(ConfigError, match="stages chicken and egg wait for each other; let one of them do without egg"):
        in_order((WRITE, chicken, egg))
    with pytest.raises(ConfigError, match="stages print and other both write to the folder printed"):
        in_order((WRITE, PRINT, dataclasses.replace(PRINT, name="other")))
