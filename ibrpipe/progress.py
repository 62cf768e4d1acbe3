"""Progress with time left: a bar on a terminal, plain lines in a log, nothing when nobody listens.

Library code calls `track`; only the command line installs a listener.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import TypeVar

T = TypeVar("T")

#: called as listener(label, done, total); the command line decides how to show it
Listener = Callable[[str, int, int], None]

_LISTENER: ContextVar[Listener | None] = ContextVar("progress_listener", default=None)


@contextmanager
def listening(listener: Listener) -> Iterator[None]:
    """Send all progress inside this block to `listener`."""
    token = _LISTENER.set(listener)
    try:
        yield
    finally:
        _LISTENER.reset(token)


def listener() -> Listener:
    """Return whoever listens; nobody may, and then a call of it does nothing."""
    return _LISTENER.get() or (lambda label, done, total: None)


def track(items: Iterable[T], label: str, total: int | None = None) -> Iterator[T]:
    """Yield `items` one by one and report how many are done."""
    if total is None:
        items = list(items)
        total = len(items)
    told = listener()
    told(label, 0, total)
    for index, item in enumerate(items):
        yield item
        told(label, index + 1, total)
