"""The true surface of a capture: where it is found, and how it comes into the world of the run's cameras."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ibrpipe.core.similarity import centers, fit_cameras, move_points, move_poses
from ibrpipe.errors import CaptureError
from ibrpipe.io.cameras.sources import has_cameras
from ibrpipe.io.captures import read_shots
from ibrpipe.io.documents.calibration import Calibration
from ibrpipe.io.documents.geometry import Geometry
from ibrpipe.io.surfaces.meshes import read_mesh
from ibrpipe.io.views import View
from ibrpipe.types import Array, Mesh

#: folder of a capture for what the pipeline must not use, and the surface in it
KEPT_ASIDE, NAMES = "truth", ("mesh.ply", "mesh.obj", "mesh.glb", "mesh.stl")
#: cameras are in one world where their centres are so near, share of their extent
SAME = 1e-4
#: cameras that differ by more than this after alignment are not those of the same photos
DIFFERENT = 0.2


@dataclass(frozen=True, eq=False)
class TrueSurface:
    """A true surface.

    Attributes
    ----------
    path : Path
    mesh : Mesh or None
        In the world of the run's cameras; None where nothing tells how it lies in it.
    told : str
        Where it comes from and how it was placed, or why it cannot be, in a sentence.
    """

    path: Path
    mesh: Mesh | None
    told: str


def find_truth(
    named: Path | None, given: Path | None, geometry: Path | None, capture: Path | None = None
) -> Path | None:
    """Return the true mesh of a run whose ``geometry.json`` is `geometry`.

    It is the one that is named, else the capture's own where the run's was made without it, else what the capture keeps
    aside in ``truth/``; a run that used the capture's mesh has none.

    Raises
    ------
    FormatError
        ``geometry.json`` is damaged.
    """
    if named is not None:
        return named
    if geometry is None or not geometry.is_file():
        return None
    if Geometry.read(geometry, "not what the geometry stage writes", "geometry").decision == "given":
        return None
    if given is not None:
        return given
    aside = [] if capture is None else [capture / KEPT_ASIDE / name for name in NAMES]
    return next((path for path in aside if path.is_file()), None)


def placed_truth(path: Path, views: Sequence[View], capture: Path | None, calibration: Path | None) -> TrueSurface:
    """Read a true mesh and bring it into the world of the views; `calibration` is the folder of stage calibrate.

    True cameras beside the mesh (``truth/sparse/0`` or ``truth/transforms.json``, photos known by their names) tell by
    which similarity. Without them the mesh must be in the world of the cameras already, which it cannot be where
    stage calibrate found cameras in a world of their own.

    Raises
    ------
    MissingFileError, FormatError
        The mesh or the true cameras are missing or damaged.
    CaptureError
        The true cameras are not those of these photos.
    """
    mesh, name = read_mesh(path), _named(path, capture)
    true = _true_cameras(path.parent, views, capture)
    if true is None:
        found = Calibration.of_folder(calibration)
        if found is not None and found.in_own_world:
            return TrueSurface(
                path,
                None,
                f"The true surface {name} was not measured against: the cameras were found in a world of their own, "
                "and no true cameras lie beside it",
            )
        return TrueSurface(path, mesh, f"The true surface is {name}, in the world of the cameras as it is")
    old, new = true
    similarity = fit_cameras(old, new)
    extent = float(np.linalg.norm(np.ptp(centers(new), axis=0)))
    if extent <= 0:
        raise CaptureError(f"{path.parent}: all cameras stand in one place, which tells no scale; remove them")
    if np.linalg.norm(centers(old) - centers(new), axis=1).max() <= SAME * extent:
        return TrueSurface(path, mesh, f"The true surface is {name}; its {len(old)} cameras are those of the run")
    rest = float(np.linalg.norm(centers(move_poses(similarity, old)) - centers(new), axis=1).mean()) / extent
    if rest > DIFFERENT:
        raise CaptureError(
            f"{path.parent}: its cameras are {100 * rest:.0f} % of their extent from those of the photos of the same "
            "names after alignment; expected the true cameras of these photos: correct or remove them"
        )
    moved = Mesh(move_points(similarity, mesh.vertices), mesh.faces)
    told = (
        f"The true surface is {name}, brought into the world of the run by the {len(old)} cameras beside it: a "
        f"similarity of scale {similarity[0]:.4g}, which leaves {100 * rest:.2g} % of their extent between their "
        "centres and the found ones"
    )
    return TrueSurface(path, moved, told)


def _named(path: Path, capture: Path | None) -> str:
    inside = capture is not None and path.is_relative_to(capture)
    return f"{path.relative_to(capture)} of the capture" if inside and capture is not None else str(path)


def _true_cameras(folder: Path, views: Sequence[View], capture: Path | None) -> tuple[Array, Array] | None:
    """Poses (N, 3, 4) of the photos that have true cameras in a folder: the true ones and those of the views."""
    if capture is None or folder.resolve() == capture.resolve() or not has_cameras(folder):
        return None
    true = {shot.file: shot.cam_from_world for shot in read_shots(folder)}
    images = capture / "images"
    found = {
        (view.image.relative_to(images).as_posix() if view.image.is_relative_to(images) else view.image.name): view
        for view in views
    }
    names = sorted(true.keys() & found.keys())
    if len(names) < 2:
        return None
    return np.array([true[name] for name in names]), np.array([found[name].camera.cam_from_world for name in names])
