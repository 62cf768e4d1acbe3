"""What a person sees while work goes on: bars with time left on a terminal, few plain lines in a log."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import TracebackType
from typing import Any, Protocol

import click

from ibrpipe.io.manifest import Manifest
from ibrpipe.progress import listening
from ibrpipe.stages.runner import Event

LINES_PER_BAR = 10
_SECONDS_BETWEEN_LINES = 2.0


class Display(Protocol):
    """Shows progress and lines of text."""

    def progress(self, label: str, done: int, total: int) -> None:
        """Show that `done` of `total` steps of `label` are done."""

    def say(self, text: str) -> None:
        """Show one line."""


class LogDisplay:
    """Plain lines on stderr, at most `LINES_PER_BAR` + 1 for each loop and none for loops that end at once."""

    def __init__(self) -> None:
        self._label = ""
        self._start = self._last = 0.0
        self._shown = 0

    def progress(self, label: str, done: int, total: int) -> None:
        """Write a line when another tenth is done and the last line is a while ago."""
        now = time.monotonic()
        if label != self._label or done == 0:
            self._label, self._start, self._last, self._shown = label, now, now, 0
        tenth = LINES_PER_BAR * done // max(total, 1)
        if tenth <= self._shown or now - self._last < _SECONDS_BETWEEN_LINES:
            return
        self._last, self._shown = now, tenth
        left = (now - self._start) * (total - done) / done
        self.say(f"  {label}: {done}/{total}" + (f", {duration(left)} left" if done < total else ""))

    def say(self, text: str) -> None:
        """Write one line."""
        click.echo(text, err=True)


class TerminalDisplay:
    """Live bars with the time left, by rich, on stderr."""

    def __init__(self) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

        columns = (TextColumn("  {task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
        self._bars = Progress(*columns, console=Console(stderr=True, highlight=False), transient=True)
        self._tasks: dict[str, Any] = {}

    def __enter__(self) -> TerminalDisplay:
        self._bars.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._bars.stop()

    def progress(self, label: str, done: int, total: int) -> None:
        """Move the bar `label`; it vanishes when it is full."""
        if label not in self._tasks:
            self._tasks[label] = self._bars.add_task(label, total=total)
        self._bars.update(self._tasks[label], completed=done, total=total)
        if done >= total:
            self._bars.remove_task(self._tasks.pop(label))

    def say(self, text: str) -> None:
        """Print one line above the bars."""
        self._bars.console.print(text, markup=False, soft_wrap=True)


@contextmanager
def display() -> Iterator[Display]:
    """Show progress inside the block in the way that suits where stderr goes."""
    if sys.stderr.isatty():
        with TerminalDisplay() as terminal, listening(terminal.progress):
            yield terminal
    else:
        log = LogDisplay()
        with listening(log.progress):
            yield log


def told(event: Event) -> str:
    """Return what happens to a stage in words: one line, and below it what the stage itself has to tell."""
    if event.kind == "starts":
        return f"{event.stage}: starts ({event.text})"
    if event.kind == "skipped":
        return f"{event.stage}: up to date"
    lines = [f"{event.stage}: done in {cost(event.manifest)}" if event.manifest else event.stage]
    return "\n".join([*lines, *(f"  {line}" for line in event.text.splitlines())])


def cost(manifest: Manifest) -> str:
    """Return seconds, memory and bytes written in words."""
    parts = [duration(manifest.seconds)]
    if manifest.peak_memory_bytes is not None:
        parts.append(f"{size(manifest.peak_memory_bytes)} of memory at most")
    return ", ".join([*parts, f"{size(sum(manifest.files.values()))} written"])


def duration(seconds: float) -> str:
    """Return a time in words: 0.42 s, 12.3 s, 4 min 05 s, 1 h 02 min."""
    if seconds < 59.95:
        return f"{seconds:.2f} s" if seconds < 9.995 else f"{seconds:.1f} s"
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest:02d} s" if minutes < 60 else f"{minutes // 60} h {minutes % 60:02d} min"


def size(count: float) -> str:
    """Return a number of bytes in words, in powers of 1000: 12 B, 3.4 kB, 56 MB."""
    for unit in ("B", "kB", "MB", "GB"):
        if count < 999.5 or unit == "GB":
            break
        count /= 1000
    return f"{count:.0f} {unit}" if unit == "B" or count >= 99.5 else f"{count:.3g} {unit}"
