"""What a person sees while work goes on: bars with time left on a terminal, few plain lines in a log."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import TracebackType
from typing import Any, Protocol

import click

from ibrpipe.engine.event_words import duration
from ibrpipe.progress import current_whole, listening

LINES_PER_BAR, LINES_OF_A_WHOLE = 10, 20
#: of loops, and of what has no known end
_SECONDS_BETWEEN_LINES, _SECONDS_BETWEEN_COUNTS = 2.0, 10.0


class Display(Protocol):
    """Shows progress and lines of text."""

    def progress(self, label: str, done: int, total: int | None) -> None:
        """Show that `done` of `total` (None = nobody knows) steps of `label` are done."""

    def say(self, text: str) -> None:
        """Show one line."""


class LogDisplay:
    """Plain lines on stderr, at most `LINES_PER_BAR` + 1 for each loop and none for loops that end at once.

    Loops that are parts of a whole share its lines, and the time left is that of the whole.
    """

    def __init__(self) -> None:
        self._label = ""
        self._start = self._last = 0.0
        self._shown = 0
        self._counted = -_SECONDS_BETWEEN_COUNTS

    def progress(self, label: str, done: int, total: int | None) -> None:
        """Write a line when another tenth is done and the last line is a while ago."""
        now, around = time.monotonic(), current_whole()
        if total is None:
            self._count(label, done, now)
            return
        key, lines = (label, LINES_PER_BAR) if around is None else (around.label, LINES_OF_A_WHOLE)
        if key != self._label or (around is None and done == 0):
            self._label, self._start, self._last, self._shown = key, now, now, 0
        share = done / max(total, 1) if around is None else around.share
        part = int(lines * share + 1e-9)
        if part <= self._shown or now - self._last < _SECONDS_BETWEEN_LINES:
            return
        self._last, self._shown = now, part
        if around is None:
            left = (now - self._start) * (total - done) / done if done < total else None
            self.say(f"  {label}: {done}/{total}" + ("" if left is None else f", {duration(left)} left"))
        else:
            left = around.left()
            told = "" if left is None else f", about {duration(left)} left"
            self.say(f"  {around.label}: {share:.0%}{told} ({label}: {done}/{total})")

    def _count(self, label: str, done: int, now: float) -> None:
        if now - self._counted >= _SECONDS_BETWEEN_COUNTS:
            self._counted = now
            self.say(f"  {label}: {done} so far")

    def say(self, text: str) -> None:
        """Write one line."""
        click.echo(text, err=True)


class TerminalDisplay:
    """Live bars with the time left, by rich, on stderr; above the bar of a loop that of the whole it belongs to."""

    def __init__(self) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TextColumn

        columns = (TextColumn("  {task.description}"), BarColumn(), TextColumn("{task.fields[count]}"), _time_left())
        self._bars = Progress(*columns, console=Console(stderr=True, highlight=False), transient=True)
        self._tasks: dict[str, Any] = {}
        self._starts: dict[str, float] = {}

    def __enter__(self) -> TerminalDisplay:
        self._bars.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._bars.stop()

    def progress(self, label: str, done: int, total: int | None) -> None:
        """Move the bar `label`; it vanishes when it is full."""
        if total is None:
            self._move(label, None, f"{done} so far", None)
            return
        around, left = current_whole(), None
        if around is not None:
            self._move(around.label, around.share, f"{around.share:.0%}", around.left())
        elif done > 0:
            left = (time.monotonic() - self._starts.get(label, time.monotonic())) * (total - done) / done
        self._move(label, done / max(total, 1), f"{done}/{total}", left)
        if done >= total:
            self._bars.remove_task(self._tasks.pop(label))

    def _move(self, label: str, share: float | None, count: str, left: float | None) -> None:
        now = time.monotonic()
        if label not in self._tasks:
            end = None if share is None else 1.0
            self._tasks[label] = self._bars.add_task(label, total=end, count=count, ends=None)
            self._starts[label] = now
        self._bars.update(self._tasks[label], completed=share, count=count, ends=None if left is None else now + left)

    def say(self, text: str) -> None:
        """Print one line above the bars."""
        self._bars.console.print(text, markup=False, soft_wrap=True)


def _time_left() -> Any:
    """Return a column that counts down to the time at which a bar should be full."""
    from rich.progress import ProgressColumn, Task
    from rich.text import Text

    class TimeLeft(ProgressColumn):
        """Time left, from ``ends`` of the task."""

        def render(self, task: Task) -> Text:
            """Write it as rich's own column does."""
            ends = task.fields.get("ends")
            if ends is None:
                return Text("")
            return Text(f"{duration(max(ends - time.monotonic(), 0.0))} left", style="progress.remaining")

    return TimeLeft()


@contextmanager
def display() -> Iterator[Display]:
    """Show progress inside the block, compilation included, in the way that suits where stderr goes."""
    from ibrpipe.compile_progress import compiling_told

    if sys.stderr.isatty():
        with TerminalDisplay() as terminal, listening(terminal.progress), compiling_told():
            yield terminal
    else:
        log = LogDisplay()
        with listening(log.progress), compiling_told():
            yield log
