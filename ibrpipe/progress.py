"""Progress with time left: a bar on a terminal, plain lines in a log, nothing when nobody listens.

Library code calls `track`; only the command line installs a listener. A stage that runs many loops says beforehand what
they will cost relative to each other (`whole`), so that the time left is that of the whole stage and not of one loop.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from typing import TypeVar

from ibrpipe.interruption import stop_if_asked

T = TypeVar("T")

#: called as listener(label, done, total), total None where no end is known; the command line decides how to show it
Listener = Callable[[str, int, int | None], None]

_LISTENER: ContextVar[Listener | None] = ContextVar("progress_listener", default=None)


@dataclass(frozen=True)
class Part:
    """One loop of a whole.

    Attributes
    ----------
    label : str
        What `track` calls it; a part that is never tracked counts as done when a later one begins.
    effort : float
        What it costs, in any unit that all parts share.
    """

    label: str
    effort: float


@dataclass(frozen=True)
class Step:
    """A loop, or work without one, declared where it runs.

    Attributes
    ----------
    label : str
        What progress calls it.
    cost : float
        What it costs for one unit of size, seconds; only the proportions of the steps of a whole matter.
    """

    label: str
    cost: float

    def part(self, size: float) -> Part:
        """Return it as a part of a whole."""
        return Part(self.label, self.cost * size)

    def track(self, items: Iterable[T], total: int | None = None) -> Iterator[T]:
        """Yield `items` one by one and report how many are done."""
        return track(items, self.label, total)

    @contextmanager
    def unheard(self) -> Iterator[None]:
        """Count the block for the whole around it, of which alone the listener hears."""
        around = current_whole()
        if around is not None:
            around.move(self.label, 0, 1)
        yield
        if around is not None:
            around.move(self.label, 1, 1)


class Whole:
    """Work of several loops, and how much of it is done.

    Attributes
    ----------
    label : str
    share : float
        Of the effort that is done, 0 to 1.
    """

    def __init__(self, label: str, parts: Sequence[Part], clock: Callable[[], float] = time.monotonic) -> None:
        self.label, self.share = label, 0.0
        self._parts, self._clock = tuple(parts), clock
        self._total = max(sum(part.effort for part in parts), 1e-12)
        self._at = -1
        self._first: tuple[float, float] | None = None  # time and share from where speed is measured

    def move(self, label: str, done: int, total: int) -> None:
        """Note that so much of a loop is done. A loop that is not among the parts ahead changes nothing."""
        if done == 0:
            ahead = [n for n in range(self._at + 1, len(self._parts)) if self._parts[n].label == label]
            self._at = ahead[0] if ahead else self._at
        if self._at < 0 or self._parts[self._at].label != label:
            return
        before = sum(part.effort for part in self._parts[: self._at])
        self.share = (before + self._parts[self._at].effort * done / max(total, 1)) / self._total
        if self._first is None and done > 0:  # the first item also pays for compiling
            self._first = (self._clock(), self.share)

    def left(self) -> float | None:
        """Return the seconds that are left at the speed so far; None where nothing tells or all is done."""
        if self._first is None or self.share <= self._first[1] or self.share > 1 - 1e-9:
            return None
        spent = self._clock() - self._first[0]
        return spent * (1 - self.share) / (self.share - self._first[1])


_WHOLE: ContextVar[Whole | None] = ContextVar("progress_whole", default=None)


@contextmanager
def listening(listener: Listener) -> Iterator[None]:
    """Send all progress inside this block to `listener`."""
    token = _LISTENER.set(listener)
    try:
        yield
    finally:
        _LISTENER.reset(token)


def current_listener() -> Listener | None:
    """Return whoever listens, if anybody does."""
    return _LISTENER.get()


def listener() -> Listener:
    """Return whoever listens; nobody may, and then a call of it does nothing."""
    return current_listener() or (lambda label, done, total: None)


@contextmanager
def whole(label: str, parts: Sequence[Part]) -> Iterator[None]:
    """Count the loops inside this block as parts of one whole; at its end the listener hears that it is done."""
    token = _WHOLE.set(Whole(label, parts))
    try:
        yield
    finally:
        _WHOLE.reset(token)
        listener()(label, 1, 1)


def current_whole() -> Whole | None:
    """Return the whole that the loop belongs to of which a listener hears, if any."""
    return _WHOLE.get()


def track(items: Iterable[T], label: str, total: int | None = None) -> Iterator[T]:
    """Yield `items` one by one and report how many are done."""
    if total is None:
        items = list(items)
        total = len(items)
    _tell(label, 0, total)
    for index, item in enumerate(items):
        stop_if_asked()
        yield item
        _tell(label, index + 1, total)


def _tell(label: str, done: int, total: int) -> None:
    around = current_whole()
    if around is not None:
        around.move(label, done, total)
    listener()(label, done, total)
