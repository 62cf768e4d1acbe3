"""Binary PLY files whose faces have different numbers of corners, which trimesh does not read.

Format: Turk, "The PLY polygon file format" (1994): a header of elements with scalar or list properties, then values.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ibrpipe.errors import FormatError
from ibrpipe.types import Array

_KINDS = {
    **dict.fromkeys(("char", "int8"), "b"),
    **dict.fromkeys(("uchar", "uint8"), "B"),
    **dict.fromkeys(("short", "int16"), "h"),
    **dict.fromkeys(("ushort", "uint16"), "H"),
    **dict.fromkeys(("int", "int32"), "i"),
    **dict.fromkeys(("uint", "uint32"), "I"),
    **dict.fromkeys(("float", "float32"), "f"),
    **dict.fromkeys(("double", "float64"), "d"),
}
_FACES = ("vertex_indices", "vertex_index")


@dataclass
class _Element:
    """An element of the header; of a list, kinds of its length and of its values."""

    name: str
    count: int
    scalars: list[tuple[str, str]] = field(default_factory=list)
    lists: dict[str, tuple[str, str]] = field(default_factory=dict)


def read_polygons(path: Path) -> tuple[Array, list[Array]]:
    """Read vertices and faces of a binary PLY.

    Returns
    -------
    points : (V, 3) float64
    polygons : list of (n,) int64

    Raises
    ------
    FormatError
        Not such a file, cut off, or with texture coordinates of its corners, which would be lost.
    """
    data = path.read_bytes()
    elements, at, order = _header(path, data)
    points: Array = np.zeros((0, 3))
    polygons: list[Array] = []
    try:
        for element in elements:
            if element.lists:
                if "texcoord" in element.lists:
                    raise FormatError(f"{path}: has texture coordinates and faces of several sizes; export triangles")
                lists, at = _lists(data, at, element, order)
                polygons = lists if element.name == "face" else polygons
                continue
            table = np.dtype([(name, order + kind) for name, kind in element.scalars])
            if element.name == "vertex":
                rows = np.frombuffer(data, table, element.count, at)
                points = np.column_stack([rows[axis].astype(np.float64) for axis in "xyz"])
            at += table.itemsize * element.count
    except (struct.error, ValueError, KeyError) as error:
        raise FormatError(f"{path}: the mesh is damaged or was cut off ({error}); export it again") from error
    return points, [polygon for polygon in polygons if len(polygon) >= 3]


def _header(path: Path, data: bytes) -> tuple[list[_Element], int, str]:
    """Elements, where their values begin, and the order of bytes."""
    end = data.find(b"end_header")
    words = [line.split() for line in data[: max(end, 0)].decode("ascii", "replace").splitlines()]
    kind = next((row[1] for row in words if row[:1] == ["format"]), "")
    order = {"binary_little_endian": "<", "binary_big_endian": ">"}.get(kind)
    if end < 0 or order is None:
        raise FormatError(f"{path}: is no binary PLY; export it again")
    elements: list[_Element] = []
    try:
        for row in words:
            if row[:1] == ["element"]:
                elements.append(_Element(row[1], int(row[2])))
            elif row[:2] == ["property", "list"]:
                elements[-1].lists[row[4]] = (_KINDS[row[2]], _KINDS[row[3]])
                elements[-1].scalars.append((row[4], ""))
            elif row[:1] == ["property"]:
                elements[-1].scalars.append((row[2], _KINDS[row[1]]))
    except (KeyError, IndexError, ValueError) as error:
        raise FormatError(f"{path}: the header is damaged ({error}); export it again") from error
    return elements, data.index(b"\n", end) + 1, order


def _lists(data: bytes, at: int, element: _Element, order: str) -> tuple[list[Array], int]:
    """The lists of vertices of an element, and where the next one begins."""
    found = []
    for _ in range(element.count):
        for name, kind in element.scalars:
            if name not in element.lists:
                at += struct.calcsize(kind)
                continue
            size, value = element.lists[name]
            (count,) = struct.unpack_from(order + size, data, at)
            at += struct.calcsize(size)
            if name in _FACES:
                found.append(np.frombuffer(data, order + value, count, at).astype(np.int64))
            at += count * struct.calcsize(value)
    if at > len(data):
        raise ValueError(f"{len(data)} bytes of {at}")
    return found, at
