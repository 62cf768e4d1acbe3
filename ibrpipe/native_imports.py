"""The one place that imports pycolmap and Open3D: both need care before and after."""

from __future__ import annotations

import signal
import threading
from typing import Any

from ibrpipe.errors import ResourceError


def import_open3d() -> Any:
    """Import Open3D, helping it to the libusb that its binary asks for.

    Raises
    ------
    ResourceError
        A system library is missing; the message says what to type.
    """
    try:
        import open3d
    except (ImportError, OSError) as first:
        try:
            _load_libusb()
            import open3d
        except (ImportError, OSError) as second:
            raise ResourceError(
                f"Open3D does not load ({second or first}); on Debian or Ubuntu type: "
                "sudo apt-get install -y libusb-1.0-0 libgl1 libegl1 libx11-6 libgomp1"
            ) from second
    return open3d


def _load_libusb() -> None:
    """Load the libusb of the package libusb-package under the name that Open3D's loader looks for."""
    import ctypes

    import libusb_package

    ctypes.CDLL(str(libusb_package.get_library_path()), mode=ctypes.RTLD_GLOBAL)


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
