"""The twin tests of the spiral side pass with Numba's compiler off, so the kernels are right as plain Python, too."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).parent
FILES = (
    "spiral/test_lookup.py",
    "appearance/test_photo_blend.py",
    "appearance/test_diffuse.py",
    "appearance/test_diffuse_lookup.py",
)


def test_twins_without_the_compiler():
    files = [str(HERE / name) for name in (*FILES, "test_normals.py")]
    files.append(str(HERE.parent / "renderers" / "view_dependence" / "test_spiral.py"))
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-k", "twin", *files]
    done = subprocess.run(
        command,
        env={**os.environ, "NUMBA_DISABLE_JIT": "1"},
        capture_output=True,
        text=True,
        check=False,
        cwd=HERE.parent.parent,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    passed = int(done.stdout.rsplit(" passed", 1)[0].split()[-1])
    assert passed >= 15
