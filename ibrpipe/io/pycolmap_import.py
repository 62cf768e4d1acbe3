"""The one place that imports pycolmap."""

from __future__ import annotations

from typing import Any


def import_pycolmap() -> Any:
    """Import pycolmap after OpenCV.

    The order matters: pycolmap loaded first makes every later PNG encoding by OpenCV abort the process
    (``free(): invalid pointer``), because both bring their own copies of the image libraries.
    """
    import cv2  # noqa: F401 (loaded first on purpose)
    import pycolmap

    return pycolmap
