"""A stop that was asked for is not lost.

A signal arrives anywhere: inside an import that turns every exception into its own, or inside a destructor, which
drops it. The command line notes the signal (`ask_to_stop`) before it raises; loops and the runner look for the note
(`stop_if_asked`) and raise again.
"""

from __future__ import annotations

import signal

_asked: int | None = None


def ask_to_stop(number: int) -> None:
    """Note the signal `number`; the next `stop_if_asked` of this process ends the work."""
    global _asked
    _asked = number


def stop_if_asked() -> None:
    """Return at once, unless a stop was asked for.

    Raises
    ------
    KeyboardInterrupt
        By SIGINT (Ctrl-C).
    SystemExit
        By another signal; the exit code is 128 + its number.
    """
    if _asked is None:
        return
    if _asked == signal.SIGINT:
        raise KeyboardInterrupt
    raise SystemExit(128 + _asked)
