"""Time left: of a whole of several loops, on a terminal and in a log; which stage of how many runs."""

from __future__ import annotations

import io
import re
from pathlib import Path

import pytest

import ibrpipe
from ibrpipe.cli import show
from ibrpipe.progress import Part, Step, Whole, current_whole, listening, track, whole
from ibrpipe.reconstruction.depth import depth_parts
from ibrpipe.reconstruction.depth.schedule import rounds_of
from ibrpipe.reconstruction.depth.settings import DepthConfig
from ibrpipe.reconstruction.surface.build import surface_parts


class Clock:
    """Seconds that pass when they are told to."""

    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now


def test_the_time_left_is_that_of_all_parts() -> None:
    clock = Clock()
    parts = [Part("a", 10), Part("b", 30), Part("unheard", 5), Part("a", 5)]
    done = Whole("stage", parts, clock)
    assert (done.share, done.left()) == (0, None)
    for n in range(11):
        done.move("a", n, 10)
        clock.now += 8.0 if n == 0 else 1.0  # the first item compiles, which tells nothing of the others
    clock.now -= 1.0
    assert done.share == pytest.approx(10 / 50)
    assert done.left() == pytest.approx(40.0)  # one unit of effort a second
    done.move("other", 0, 3)
    done.move("other", 2, 3)
    assert done.share == pytest.approx(10 / 50)
    done.move("a", 0, 1)  # b was skipped: its share counts as done
    assert done.share == pytest.approx(45 / 50)


def test_a_listener_finds_the_whole_and_hears_its_end() -> None:
    heard = []

    def hear(label: str, done: int, total: int) -> None:
        around = current_whole()
        heard.append((label, done, total, None if around is None else round(around.share, 3)))

    with listening(hear):
        with whole("stage", [Part("one", 1), Part("two", 3)]):
            list(track([0], "one"))
            list(track([0, 0], "two"))
        list(track([0], "alone"))
    assert heard == [
        ("one", 0, 1, 0.0), ("one", 1, 1, 0.25), ("two", 0, 2, 0.25), ("two", 1, 2, 0.625), ("two", 2, 2, 1.0),
        ("stage", 1, 1, None), ("alone", 0, 1, None), ("alone", 1, 1, None),
    ]  # fmt: skip


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    made = Clock()
    monkeypatch.setattr(show.time, "monotonic", made)
    return made


def run_loops(clock: Clock) -> None:
    with whole("geometry", [Part("depth 1/2", 10), Part("depth 2/2", 30)]):
        _set_clock(clock)
        for label, count, seconds in (("depth 1/2", 10, 3.0), ("depth 2/2", 10, 9.0)):
            for _ in track(range(count), label):
                clock.now += seconds


def _set_clock(clock: Clock) -> None:
    around = current_whole()
    assert around is not None
    around._clock = clock


def test_a_log_counts_down_the_whole_stage(clock: Clock, capsys: pytest.CaptureFixture[str]) -> None:
    with listening(show.LogDisplay().progress):
        run_loops(clock)
    lines = capsys.readouterr().err.splitlines()
    assert 10 <= len(lines) <= 20
    found = [
        re.fullmatch(r"  geometry: (\d+)%(?:, about (.+) left)? \(depth (\d)/2: (\d+)/10\)", line) for line in lines
    ]
    assert all(found)
    assert lines[1] == "  geometry: 10%, about 1 min 48 s left (depth 1/2: 4/10)"
    assert lines[-1] == "  geometry: 100% (depth 2/2: 10/10)"


def test_a_terminal_shows_the_whole_above_its_loop(clock: Clock, monkeypatch: pytest.MonkeyPatch) -> None:
    from rich.console import Console

    display, seen = show.TerminalDisplay(), []
    display._bars.live.console = Console(file=io.StringIO(), force_terminal=True, width=100)

    def look(label: str, done: int, total: int) -> None:
        display.progress(label, done, total)
        console = Console(file=io.StringIO(), width=100)
        console.print(display._bars.make_tasks_table(display._bars.tasks))
        seen.append(console.file.getvalue())

    with listening(look):
        run_loops(clock)
    half = seen[14]
    assert re.search(r"geometry .* 48% +1 min 03 s left", half), half
    assert re.search(r"depth 2/2 .* 3/10 *\n", half), half  # the loop itself has no time of its own
    assert half.index("geometry") < half.index("depth 2/2")
    assert not display._bars.tasks  # nothing stays when all is done


def test_a_log_counts_what_has_no_known_end_now_and_then(clock: Clock, capsys: pytest.CaptureFixture[str]) -> None:
    display = show.LogDisplay()
    display.progress("loop", 0, 10)
    for done in range(25):
        display.progress("kernels", done, None)
        clock.now += 1.0
    display.progress("kernels", 25, 25)
    display.progress("loop", 5, 10)
    lines = capsys.readouterr().err.splitlines()
    assert lines[:3] == [f"  kernels: {done} so far" for done in (0, 10, 20)]


def test_a_terminal_pulses_while_no_end_is_known(clock: Clock) -> None:
    from rich.console import Console

    display = show.TerminalDisplay()
    display._bars.live.console = Console(file=io.StringIO(), force_terminal=True, width=100)
    display.progress("kernels", 3, None)
    (bar,) = display._bars.tasks
    assert bar.total is None
    assert bar.fields["count"] == "3 so far"
    display.progress("kernels", 4, 4)
    assert not display._bars.tasks


def test_a_step_is_a_part_and_its_loop() -> None:
    step, other, seen = Step("one", 2.0), Step("two", 3.0), []

    def listen(*told: object) -> None:
        around = current_whole()
        seen.append((*told, None if around is None else around.share))

    with listening(listen), whole("all", [step.part(3), other.part(2)]):
        with step.unheard():
            assert seen == []
        assert current_whole().share == 0.5
        assert list(other.track("ab")) == ["a", "b"]
        assert seen == [("two", 0, 2, 0.5), ("two", 1, 2, 0.75), ("two", 2, 2, 1.0)]
    with step.unheard():  # without a whole
        assert current_whole() is None


def test_every_step_runs_where_it_is_declared_and_no_part_has_another_label() -> None:
    package = Path(ibrpipe.__file__).parent
    declared = 0
    for path in package.rglob("*.py"):
        text = path.read_text(encoding="utf-8")
        for line in re.findall(r"^([A-Z_, ]+) = Step\(", text, re.MULTILINE):
            for name in line.split(", "):
                declared += 1
                assert f"{name}.track(" in text or f"{name}.unheard()" in text, f"{path.name}: {name}"
        if path.name != "progress.py" and "synthetic" not in path.parts:
            made = re.search(r"(?<![\w.])Part\(", text) and re.search(r"progress import .*\bPart\b", text)
            assert not made, f"{path.name} makes a part of no step"
    assert declared >= 12


def test_parts_of_depth_have_the_names_of_its_loops(views_640: list) -> None:
    config = DepthConfig()
    rounds = rounds_of([view.camera for view in views_640], config)
    parts = depth_parts(views_640, config)
    assert [part.label for part in parts] == [
        *(f"depth {n + 1}/{len(rounds)}" for n in range(len(rounds))),
        "depth maps",
    ]
    assert parts[-2].effort > 4 * parts[1].effort / 2  # the last rounds have sixteen times the pixels
    assert sum(part.effort for part in parts) > 2 * sum(part.effort for part in surface_parts(0.6144))
    draft = depth_parts(views_640, DepthConfig(method="sgbm"))
    assert [part.label for part in draft] == ["depth by pairs", "depth maps"]


@pytest.fixture
def views_640() -> list:
    from pathlib import Path

    from ibrpipe.io.views import View
    from ibrpipe.types import Camera

    camera = Camera.look_at([0, 0, 3], [0, 0, 0], up=(0, 1, 0), fov_y_deg=40, width=640, height=480)
    return [View(str(n), camera, Path(f"{n}.png")) for n in range(2)]
