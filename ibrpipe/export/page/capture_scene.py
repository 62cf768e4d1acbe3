"""A capture, or a run so far, as there is to see of it: photos with cameras, sparse points, a mesh."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ibrpipe.errors import CaptureError, MissingFileError
from ibrpipe.export.asset_folders import CONFIDENCE, MESH
from ibrpipe.export.cameras import POINTS
from ibrpipe.export.surface.decimate import at_most
from ibrpipe.io.cameras.shots import PHOTO_SUFFIXES, photo_root
from ibrpipe.io.captures import CaptureOptions, has_cameras, read_capture
from ibrpipe.io.manifest import RUN_NAME
from ibrpipe.io.points import points_of_views, read_points
from ibrpipe.io.scenes.painted import read_painted
from ibrpipe.io.surfaces.meshes import read_vertex_values
from ibrpipe.io.views import INGESTED, View, read_views
from ibrpipe.synthetic.instanced.pieces import joined
from ibrpipe.types import Array, PaintedMesh

#: name of the file that tells a folder of views
VIEWS = Path(INGESTED).name
#: triangles and points of a page at most
MOST_FACES, MOST_POINTS = 200_000, 200_000


@dataclass(frozen=True, eq=False)
class CaptureScene:
    """What there is to see.

    Attributes
    ----------
    name : str
    train, test : tuple of View
    points : (P, 3) float64, or None
        World positions.
    first_view : (P,) int64, or None
        Index of the first training view that sees each point.
    mesh : PaintedMesh or None
    confidence : (V,) float32, or None
        Of the mesh's vertices, 0 to 1, where the run knows it.
    told : tuple of str
        What was left out.
    """

    name: str
    train: tuple[View, ...]
    test: tuple[View, ...]
    points: Array | None
    first_view: Array | None
    mesh: PaintedMesh | None
    confidence: Array | None
    told: tuple[str, ...]


def read_capture_scene(source: Path, allow_outside: bool = False) -> CaptureScene:
    """Read a capture folder, a run folder, or a ``views.json`` or the folder that holds it.

    Parameters
    ----------
    source : Path
    allow_outside : bool
        What a capture consists of may lie outside its folder.

    Raises
    ------
    CaptureError
        Its photos have no cameras, or it cannot be used for another reason.
    MissingFileError, FormatError
        There is nothing of the kind, or a file is damaged.
    """
    for views in (source, source / VIEWS, source / INGESTED):
        if views.name == VIEWS and views.is_file():
            return _of_run(views)
    if (source / RUN_NAME).is_file():
        raise MissingFileError(f"{source}: this run has no checked photos yet; go on with ibrpipe run --out {source}")
    if not source.is_dir():
        raise MissingFileError(f"{source}: is no folder; give an asset, a run, or a capture with photos and cameras")
    if not has_cameras(source):
        raise CaptureError(_without_cameras(source))
    return _of_capture(source, allow_outside)


def _without_cameras(folder: Path) -> str:
    photos = sum(path.suffix.lower() in PHOTO_SUFFIXES for path in photo_root(folder).rglob("*"))
    if not photos:
        return f"{folder}: holds no asset, no run, and no photos; give a folder that ibrpipe inspect knows"
    return f"{folder}: no cameras are known for its {photos} photos; find them with: ibrpipe run {folder} --out out"


def _of_run(views: Path) -> CaptureScene:
    read, run = read_views(views), views.resolve().parent.parent
    stored = views.parent / Path(POINTS).name
    points = read_points(stored) if stored.is_file() else None
    mesh = run / MESH if (run / MESH).is_file() else read.mesh
    first = None if points is None else points.views[points.offsets[:-1]]
    return _scene(run.name, read.train, read.test, None if points is None else points.xyz, first, mesh)


def _of_capture(folder: Path, allow_outside: bool) -> CaptureScene:
    capture = read_capture(folder, CaptureOptions(hold_out_every=0, allow_outside=allow_outside))
    root = photo_root(capture.root)
    points = None if capture.model is None else points_of_views(capture.model, root, capture.train)
    first = None if points is None else points.views[points.offsets[:-1]]
    name, xyz = capture.root.name, None if points is None else points.xyz
    return _scene(name, capture.train, capture.test, xyz, first, capture.mesh)


def _scene(
    name: str, train: tuple[View, ...], test: tuple[View, ...], points: Array | None, first: Array | None,
    mesh: Path | None,
) -> CaptureScene:  # fmt: skip
    told = []
    if points is not None and first is not None and len(points) > MOST_POINTS:
        kept = np.linspace(0, len(points) - 1, MOST_POINTS).astype(np.int64)
        told.append(f"{MOST_POINTS} of {len(points)} points are shown")
        points, first = points[kept], first[kept]
    painted, confidence = (None, None) if mesh is None else _read_mesh(mesh)
    if painted is not None:
        faces = len(painted.mesh.faces)
        painted, confidence = at_most(painted, MOST_FACES, confidence)
        if len(painted.mesh.faces) < faces:
            told.append(f"the mesh of {faces} triangles is shown as {len(painted.mesh.faces)}")
    return CaptureScene(name, train, test, points, first, painted, confidence, tuple(told))


def _read_mesh(path: Path) -> tuple[PaintedMesh, Array | None]:
    """Read a mesh with the colours that its file has, and its confidence where a run has made it."""
    painted = joined(read_painted(path))
    known = read_vertex_values(path).get(CONFIDENCE) if path.suffix.lower() == ".ply" else None
    return painted, known if known is not None and len(known) == len(painted.mesh.vertices) else None
