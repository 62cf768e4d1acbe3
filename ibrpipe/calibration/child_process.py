"""A Python module run in a process of its own: what crashes or hangs there does not take the pipeline with it.

The child writes one JSON object per line to its standard output: ``{"progress": [label, done, total]}``, at the end
``{"result": {...}}`` or ``{"error": [kind, message]}``. Its standard input stays open as long as the parent lives; the
child ends itself when it closes.
"""

from __future__ import annotations

import json
import os
import queue
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import IO, Any

from ibrpipe import errors
from ibrpipe.errors import IbrError, ResourceError

Progress = Callable[[str, int, int], None]


def run_child(module: str, argument: Path, log: Path, seconds: float, progress: Progress) -> dict[str, Any]:
    """Run ``python -m MODULE ARGUMENT`` and return its result.

    Parameters
    ----------
    module : str
    argument : Path
        The one word on its command line.
    log : Path
        File that receives what the child writes to standard error.
    seconds : float
        Time limit.
    progress : callable
        Called as progress(label, done, total).

    Raises
    ------
    IbrError
        As the child raised it.
    ResourceError
        The child crashed or took too long; the message names the log.
    """
    with log.open("wb") as errors_to:
        child = subprocess.Popen(
            [sys.executable, "-m", module, str(argument)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=errors_to,
            env=_environment(),
        )
        try:
            return _listen(child, log, seconds, progress)
        finally:
            _end(child)


def _environment() -> dict[str, str]:
    """Return the environment in which the child finds this very package; products of matrices take one thread each."""
    here = str(Path(errors.__file__).parent.parent)
    paths = [here, *filter(None, os.environ.get("PYTHONPATH", "").split(os.pathsep))]
    return {
        **os.environ,
        "PYTHONPATH": os.pathsep.join(dict.fromkeys(paths)),
        "PYTHONUTF8": "1",
        "OPENBLAS_NUM_THREADS": "1",
    }


def _listen(child: subprocess.Popen[bytes], log: Path, seconds: float, progress: Progress) -> dict[str, Any]:
    assert child.stdout is not None
    lines: queue.Queue[bytes | None] = queue.Queue()
    threading.Thread(target=_forward, args=(child.stdout, lines), daemon=True).start()
    until, label = time.monotonic() + seconds, "start"
    while True:
        try:
            line = lines.get(timeout=max(0.0, until - time.monotonic()))
        except queue.Empty:
            raise ResourceError(
                f"calibration took longer than {seconds / 60:.3g} minutes (it was at: {label}); raise "
                "calibrate.time_limit or set calibrate.pairs: near, and run the same command again to go on"
            ) from None
        if line is None:
            raise ResourceError(_death(child, log, label))
        message = _parsed(line)
        if "progress" in message:
            label, done, total = message["progress"]
            progress(label, done, total)
        elif "error" in message:
            kind, text = message["error"]
            raise _error(kind)(text)
        elif "result" in message:
            result: dict[str, Any] = message["result"]
            return result


def _forward(source: IO[bytes], lines: queue.Queue[bytes | None]) -> None:
    for line in source:
        lines.put(line)
    lines.put(None)


def _parsed(line: bytes) -> dict[str, Any]:
    """Return a message; anything else that native code prints counts as nothing."""
    try:
        message = json.loads(line)
    except ValueError:
        return {}
    return message if isinstance(message, dict) else {}


def _error(kind: str) -> type[IbrError]:
    found = getattr(errors, kind, IbrError)
    return found if isinstance(found, type) and issubclass(found, IbrError) else IbrError


def _death(child: subprocess.Popen[bytes], log: Path, label: str) -> str:
    """Return the line for a child that ended without a word."""
    code = child.wait(timeout=10)
    how = f"ended with code {code}"
    if code < 0:
        names = {number.value: number.name for number in signal.Signals}
        how = f"was ended by {names.get(-code, f'signal {-code}')}"
    why = " (probably out of memory)" if code == -9 else ""
    return (
        f"calibration {how}{why} at: {label}; its last words are in {log}. Run the same command again to go on, "
        "with calibrate.max_size or calibrate.features smaller if it happens again"
    )


def _end(child: subprocess.Popen[bytes]) -> None:
    if child.poll() is None:
        child.kill()
    child.wait()
    for stream in (child.stdin, child.stdout):
        if stream is not None:
            stream.close()
