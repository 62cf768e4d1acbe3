"""Embree's C interface with instances, as the library inside the `embreex` wheel offers it."""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from ibrpipe.errors import ResourceError
from ibrpipe.types import Array

_TRIANGLES, _INSTANCE = 0, 121
_INDEX, _VERTEX = 0, 1
_UINT3, _FLOAT3, _COLUMNS34 = 0x5003, 0x9003, 0x9234
_HIGH_QUALITY = 2

_P, _I, _U, _S = ctypes.c_void_p, ctypes.c_int, ctypes.c_uint, ctypes.c_size_t
_FUNCTIONS: dict[str, tuple[Any, list[Any]]] = {
    "rtcNewDevice": (_P, [ctypes.c_char_p]),
    "rtcGetDeviceError": (_I, [_P]),
    "rtcNewScene": (_P, [_P]),
    "rtcSetSceneBuildQuality": (None, [_P, _I]),
    "rtcCommitScene": (None, [_P]),
    "rtcReleaseScene": (None, [_P]),
    "rtcNewGeometry": (_P, [_P, _I]),
    "rtcSetSharedGeometryBuffer": (None, [_P, _I, _U, _I, _P, _S, _S, _S]),
    "rtcSetGeometryInstancedScene": (None, [_P, _P]),
    "rtcSetGeometryTransform": (None, [_P, _U, _I, _P]),
    "rtcCommitGeometry": (None, [_P]),
    "rtcAttachGeometry": (_U, [_P, _P]),
    "rtcReleaseGeometry": (None, [_P]),
    "rtcIntersect16": (None, [_P, _P, _P, _P]),
}


@cache
def embree() -> ctypes.CDLL:
    """Return the library.

    Raises
    ------
    ResourceError
        The extra is not installed, or its library has another form.
    """
    found = find_spec("embreex")
    if found is None or found.origin is None:
        raise ResourceError("the wheel embreex is not installed; pip install ibrpipe[peers]")
    folder = Path(found.origin).parent.parent
    files = sorted([*folder.glob("embreex.libs/*embree4*"), *folder.glob("embreex/*embree4*")])
    if not files:
        raise ResourceError(f"{folder}: embreex brings no library of Embree 4; pip install 'embreex>=4.4'")
    for helper in sorted(folder.glob("embreex.libs/*tbb*")):
        ctypes.CDLL(str(helper), mode=ctypes.RTLD_GLOBAL)
    library = ctypes.CDLL(str(files[0]))
    for name, (result, arguments) in _FUNCTIONS.items():
        function = getattr(library, name)
        function.restype, function.argtypes = result, arguments
    return library


@cache
def _device(threads: int) -> int:
    return int(embree().rtcNewDevice(f"threads={threads}".encode()))


def _checked(threads: int) -> None:
    code = embree().rtcGetDeviceError(_device(threads))
    if code != 0:
        raise ResourceError(f"Embree reports error {code} while it builds its tree; is there enough memory?")


@dataclass
class EmbreeScene:
    """A scene of triangles and instances; buffers that it shares are kept alive here."""

    threads: int

    def __post_init__(self) -> None:
        self.handle = embree().rtcNewScene(_device(self.threads))
        embree().rtcSetSceneBuildQuality(self.handle, _HIGH_QUALITY)
        self._kept: list[Any] = []

    def add_mesh(self, corners: Array) -> None:
        """Add triangles given by (F, 3, 3) corners."""
        count = 3 * len(corners)
        vertices = np.zeros(3 * count + 4, np.float32)
        vertices[: 3 * count] = corners.ravel()
        faces = np.arange(count, dtype=np.uint32)
        library = embree()
        geometry = library.rtcNewGeometry(_device(self.threads), _TRIANGLES)
        library.rtcSetSharedGeometryBuffer(geometry, _VERTEX, 0, _FLOAT3, vertices.ctypes.data, 0, 12, count)
        library.rtcSetSharedGeometryBuffer(geometry, _INDEX, 0, _UINT3, faces.ctypes.data, 0, 12, len(corners))
        self._attach(geometry, vertices, faces)

    def add_instance(self, scene: EmbreeScene, matrix: Array) -> None:
        """Add a copy of another scene, placed by a (3, 4) matrix."""
        columns = np.ascontiguousarray(matrix.T, np.float32)
        library = embree()
        geometry = library.rtcNewGeometry(_device(self.threads), _INSTANCE)
        library.rtcSetGeometryInstancedScene(geometry, scene.handle)
        library.rtcSetGeometryTransform(geometry, 0, _COLUMNS34, columns.ctypes.data)
        self._attach(geometry, scene)

    def _attach(self, geometry: int, *kept: Any) -> None:
        library = embree()
        library.rtcCommitGeometry(geometry)
        library.rtcAttachGeometry(self.handle, geometry)
        library.rtcReleaseGeometry(geometry)
        self._kept += kept

    def commit(self) -> None:
        """Build the tree."""
        embree().rtcCommitScene(self.handle)
        _checked(self.threads)
