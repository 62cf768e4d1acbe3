"""Progress while kernels are compiled: who waits longer than a second hears so, and how many are done.

How many there will be nobody knows beforehand, so that the total told is None until all is done. Garbage is not
collected meanwhile: compilers keep nearly all that they make, and looking through it took a fifth of their time.
"""

from __future__ import annotations

import gc
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar

from numba.core import event

from ibrpipe.progress import Listener, current_listener

#: what progress calls it
LABEL = "compile kernels (kept for next time)"
#: seconds before the first word, and between two
FIRST, NEXT = 1.0, 3.0


class Watch(event.Listener):
    """Hears of every function that Numba compiles, those that others call included.

    Numba compiles in one thread at a time; what lies in the cache is loaded without a word.
    """

    def __init__(self, tell: Listener, clock: Callable[[], float] = time.monotonic) -> None:
        self._tell, self._clock = tell, clock
        self._done = self._depth = 0
        self._next: float | None = None  # when there is something to tell
        self._open = self._collects = False

    def on_start(self, event: event.Event) -> None:
        """Pause the collector with the outermost function; say that time passes."""
        if self._depth == 0:
            self._collects = gc.isenabled()
            gc.disable()
        self._depth += 1
        self.waited()

    def on_end(self, event: event.Event) -> None:
        """Count a finished outermost function, and let the collector go on."""
        if self._depth == 0:  # another thread had begun it before anybody listened
            return
        self._depth -= 1
        if self._depth == 0:
            self._done += 1
            self._let_collect()
        self.waited()

    def waited(self) -> None:
        """Tell how much is done if the last word is a while ago."""
        now = self._clock()
        if self._next is None:
            self._next = now + FIRST
        if now >= self._next:
            self._next, self._open = now + NEXT, True
            self._tell(LABEL, self._done, None)

    def close(self) -> None:
        """Say that all is done, if anything was told; another thread may be compiling still."""
        if self._depth > 0:
            self._let_collect()
        if self._open:
            self._tell(LABEL, max(self._done, 1), max(self._done, 1))

    def _let_collect(self) -> None:
        if self._collects:
            gc.enable()


_WATCH: ContextVar[Watch | None] = ContextVar("compile_watch", default=None)


@contextmanager
def compiling_told(tell: Listener | None = None) -> Iterator[None]:
    """Tell of kernels that are compiled inside the block, unless a block around this one does.

    Parameters
    ----------
    tell : callable, optional
        By default who listens to progress; where nobody does, lines go to stderr (of the main thread alone: threads
        work for somebody who may listen).
    """
    if _WATCH.get() is not None:
        yield
        return
    watch = Watch(tell or current_listener() or _unheard())
    token = _WATCH.set(watch)
    try:
        with event.install_listener("numba:compile", watch):
            yield
    finally:
        _WATCH.reset(token)
        watch.close()


def still_waiting() -> None:
    """Tell that another process compiles, where that is told."""
    watch = _WATCH.get()
    if watch is not None:
        watch.waited()


def line_of(label: str, done: int, total: int | None) -> str:
    """Return what is told in words."""
    return f"{label}: {done} so far" if total is None else f"{label}: {done}, all done"


def _unheard() -> Listener:
    if threading.current_thread() is threading.main_thread():
        return _to_stderr
    return lambda label, done, total: None


def _to_stderr(label: str, done: int, total: int | None) -> None:
    if sys.stderr is not None:  # a program without a console has none
        sys.stderr.write(f"ibrpipe: {line_of(label, done, total)}\n")
