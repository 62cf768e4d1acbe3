"""A stop that was asked for ends the work, whatever swallowed it first."""

from __future__ import annotations

import signal
import subprocess
import sys

import pytest

import ibrpipe.interruption as interruption
from ibrpipe.progress import track


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(interruption, "_asked", None)


def test_nothing_happens_unasked(asked: None) -> None:
    interruption.stop_if_asked()
    assert list(track([1, 2], "loop")) == [1, 2]


def test_a_loop_ends_at_its_next_item(asked: None) -> None:
    loop = track([1, 2, 3], "loop")
    assert next(loop) == 1
    interruption.ask_to_stop(signal.SIGINT)
    with pytest.raises(KeyboardInterrupt):
        next(loop)


def test_another_signal_ends_the_process_with_its_code(asked: None) -> None:
    interruption.ask_to_stop(signal.SIGTERM)
    with pytest.raises(SystemExit) as ended:
        interruption.stop_if_asked()
    assert ended.value.code == 128 + signal.SIGTERM


SWALLOWED = """
import os, signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)
import click
import ibrpipe.cli.main as main
from ibrpipe.progress import track

@main.cli.command("swallow")
def swallow():
    try:
        os.kill(os.getpid(), signal.SIG{name})
    except BaseException:
        pass
    for _ in track(range(3), "loop"):
        pass
    print("went on")

main.LazyGroup.get_command = lambda self, ctx, name: swallow
sys.argv = ["ibrpipe", "swallow"]
main.main()
"""


@pytest.mark.skipif(sys.platform == "win32", reason="signals")
@pytest.mark.parametrize(("name", "code"), [("INT", 130), ("TERM", 143)])
def test_a_signal_that_an_import_swallows_is_not_lost(name: str, code: int) -> None:
    done = subprocess.run(
        [sys.executable, "-c", SWALLOWED.format(name=name)], capture_output=True, text=True, check=False
    )
    assert done.returncode == code, done.stderr
    assert "went on" not in done.stdout
    assert "Traceback" not in done.stderr
