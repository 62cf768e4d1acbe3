"""pycolmap must not take over SIGTERM: a run that is told to end cleans up behind itself."""

import signal
import subprocess
import sys

import pytest

CODE = """
import os, signal, sys
{before}
from ibrpipe.native_imports import import_pycolmap
import_pycolmap()
os.kill(os.getpid(), signal.SIGTERM)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="signals")
@pytest.mark.parametrize(
    ("before", "code"),
    [("signal.signal(signal.SIGTERM, lambda *_: sys.exit(7))", 7), ("", -signal.SIGTERM)],
)
def test_sigterm_is_answered_as_before(before: str, code: int) -> None:
    result = subprocess.run([sys.executable, "-c", CODE.format(before=before)], capture_output=True, text=True)
    assert result.returncode == code, result.stderr
    assert result.stderr == ""
