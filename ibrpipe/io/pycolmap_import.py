"""The one place that imports pycolmap."""

from __future__ import annotations

import signal
import threading
from typing import Any


def import_pycolmap() -> Any:
    """Import pycolmap after OpenCV, and keep this process's own answer to SIGTERM.

    The order matters: pycolmap loaded first makes every later PNG encoding by OpenCV abort the process
    (``free(): invalid pointer``), because both bring their own copies of the image libraries. And pycolmap answers
    SIGTERM with a stack trace and an abort, so that nothing half-written would be cleaned up.
    """
    import cv2  # noqa: F401 (loaded first on purpose)

    before = signal.getsignal(signal.SIGTERM)
    import pycolmap

    if before is not None and threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGTERM, before)
    return pycolmap
