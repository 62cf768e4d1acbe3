"""Sparse points of a COLMAP model: where they are, and which photos see them; as ``points.npz`` in a run folder."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ibrpipe.errors import FormatError, MissingFileError
from ibrpipe.io.cameras.colmap import Cursor, image_names, text_lines
from ibrpipe.io.cameras.shots import PhotoFolder
from ibrpipe.io.untrusted.arrays import load_npz
from ibrpipe.io.untrusted.boundary import reader
from ibrpipe.io.views import View
from ibrpipe.types import Array

_NAMES = ("xyz", "error", "offsets", "views")
#: number, position, mean reprojection error, numbers of the images that see it
_Point = tuple[int, tuple[float, ...], float, Sequence[int]]


@dataclass(frozen=True, eq=False)
class SparsePoints:
    """Points that photos have in common.

    Attributes
    ----------
    xyz : (P, 3) float64
        World, scene units.
    error : (P,) float32
        Mean reprojection error in pixels of the photo file; -1 = unknown.
    offsets : (P + 1,) int64
        Point i is seen by ``views[offsets[i]:offsets[i + 1]]``.
    views : (M,) int32
        Indices of views, ascending within a point.
    """

    xyz: Array
    error: Array
    offsets: Array
    views: Array


def points_of_views(model: Path, images: Path, views: Sequence[View]) -> SparsePoints | None:
    """Read the points of a COLMAP model that at least two of the `views` see.

    Parameters
    ----------
    model : Path
        Folder with images and points3D, .bin or .txt.
    images : Path
        Folder that the names of its images are relative to.
    views : sequence of View
        Others than these count as not there.

    Returns
    -------
    SparsePoints or None
        In the order of COLMAP's numbers; None where the model holds no such point.

    Raises
    ------
    FormatError
        The file of points is damaged.
    """
    source = next((model / name for name in ("points3D.bin", "points3D.txt") if (model / name).is_file()), None)
    if source is None:
        return None
    where = {view.image: index for index, view in enumerate(views)}
    photos = PhotoFolder(images)
    files = {key: photos.of_model(name, model) for key, name in image_names(model).items()}
    known = {key: where[file] for key, file in files.items() if file in where}
    found = _points_binary(source) if source.suffix == ".bin" else _points_text(source)
    seen = [
        (xyz, error, sorted({known[key] for key in track if key in known})) for _, xyz, error, track in sorted(found)
    ]
    kept = [point for point in seen if len(point[2]) >= 2 and all(map(math.isfinite, point[0]))]
    if not kept:
        return None
    xyz, errors, tracks = zip(*kept)
    return SparsePoints(
        np.array(xyz, np.float64),
        np.array(errors, np.float32),
        np.cumsum([0, *map(len, tracks)]).astype(np.int64),
        np.concatenate(tracks).astype(np.int32),
    )


def write_points(points: SparsePoints, path: Path) -> None:
    """Write ``points.npz``."""
    np.savez(path, **{name: getattr(points, name) for name in _NAMES})


@reader("run the ingest stage again")
def read_points(path: Path) -> SparsePoints:
    """Read ``points.npz``.

    Raises
    ------
    MissingFileError, FormatError
        The file does not exist or is not what `write_points` writes.
    """
    if not path.is_file():
        raise MissingFileError(f"{path}: does not exist; run the ingest stage on a capture with sparse points")
    stored = load_npz(path, "run the ingest stage again", "not a file of sparse points")
    return SparsePoints(*(stored[name] for name in _NAMES))


def _points_text(path: Path) -> Iterator[_Point]:
    for where, line in text_lines(path):
        words = line.split()
        if not words:
            continue
        try:
            key, xyz, error = int(words[0]), tuple(map(float, words[1:4])), float(words[7])
            track = [int(word) for word in words[8::2]]
        except (ValueError, IndexError) as problem:
            raise FormatError(f"{where}: expected ID X Y Z R G B ERROR and a track, got {line[:80]!r}") from problem
        yield key, xyz, error, track


def _points_binary(path: Path) -> Iterator[_Point]:
    cursor = Cursor(path)
    for _ in range(cursor.take("Q")[0]):
        key, x, y, z, _, _, _, error, length = cursor.take("Q3d3BdQ")
        start = cursor.skip(8 * length)
        track = np.frombuffer(cursor.data, "<u4", 2 * length, start)[::2]
        yield key, (x, y, z), error, track.tolist()
