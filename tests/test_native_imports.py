"""pycolmap loaded before OpenCV makes OpenCV's PNG encoding abort the process: nobody may import it in that order."""

import re
import subprocess
import sys
from pathlib import Path

import ibrpipe

ENCODE = "import cv2, numpy; assert cv2.imencode('.png', numpy.zeros((8, 8, 3), numpy.uint8))[0]"


def run_python(code):
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120)


def test_opencv_still_encodes_png_after_our_import():
    result = run_python(
        f"from ibrpipe.native_imports import import_pycolmap; import_pycolmap(); {ENCODE}; print('fine')"
    )
    assert result.returncode == 0, result.stderr
    assert result.stdout.strip() == "fine"


def test_opencv_still_encodes_png_after_a_colmap_model_was_read(tiny_ball):
    code = f"from ibrpipe import read_capture; read_capture({str(tiny_ball)!r}); {ENCODE}; print('fine')"
    result = run_python(code)
    assert result.returncode == 0, result.stderr
    assert result.stdout.strip() == "fine"


def test_only_one_module_imports_pycolmap():
    package = Path(ibrpipe.__file__).parent
    importers = [
        path.name
        for path in package.rglob("*.py")
        if re.search(r"^\s*(import|from) pycolmap\b", path.read_text(encoding="utf-8"), re.MULTILINE)
    ]
    assert importers == ["native_imports.py"]
