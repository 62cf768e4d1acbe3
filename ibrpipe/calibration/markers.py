"""ArUco markers and ChArUco boards in the photos: their corners, and where these are in the world."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ibrpipe.calibration.features import coded_grey
from ibrpipe.calibration.job import PhotoEntry
from ibrpipe.core.reconstruction.triangulation import triangulate_agreed
from ibrpipe.core.similarity import fit_points, move_points, spread
from ibrpipe.errors import CaptureError
from ibrpipe.io.cameras.colmap_write import ModelImage, SparseModel
from ibrpipe.io.cameras.lenses import directions_of
from ibrpipe.io.photos.image_files import read_stored
from ibrpipe.types import Array

#: A corner counts when its photos agree on its position to so many pixels
AGREE = 3.0
#: (marker, corner): corners count clockwise from the top left; of a board, (-1, corner)
Corner = tuple[int, int]


@dataclass(frozen=True)
class Spot:
    """Where photos see something: names of photos to pixels (x, y)."""

    seen: dict[str, tuple[float, float]]


def find_corners(photos: Sequence[PhotoEntry], markers: dict[str, Any]) -> dict[Corner, Spot]:
    """Look for the corners of markers in all photos.

    Parameters
    ----------
    photos : sequence of PhotoEntry
        Masks are left aside: markers usually stand beside the object.
    markers : mapping
        Settings ``dictionary``, ``board``, ``square``, ``size``.
    """
    found: dict[Corner, dict[str, tuple[float, float]]] = {}
    detect = _board_detector(markers) if markers["board"] else _marker_detector(markers)
    for photo in photos:
        pixels, header = read_stored(Path(photo.image))
        for corner, pixel in detect(coded_grey(pixels, header, Path(photo.image))):
            found.setdefault(corner, {})[photo.name] = pixel
    return {corner: Spot(seen) for corner, seen in sorted(found.items())}


def _marker_detector(markers: dict[str, Any]) -> Any:
    import cv2

    settings = cv2.aruco.DetectorParameters()
    settings.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    detector = cv2.aruco.ArucoDetector(_dictionary(markers["dictionary"]), settings)

    def detect(grey: Array) -> list[tuple[Corner, tuple[float, float]]]:
        corners, keys, _ = detector.detectMarkers(grey)
        if keys is None:
            return []
        return [
            ((int(key), index), (float(x) + 0.5, float(y) + 0.5))
            for key, four in zip(np.ravel(keys), corners)
            for index, (x, y) in enumerate(np.reshape(four, (4, 2)))
        ]

    return detect


def _board_detector(markers: dict[str, Any]) -> Any:
    import cv2

    detector = cv2.aruco.CharucoDetector(_board(markers))

    def detect(grey: Array) -> list[tuple[Corner, tuple[float, float]]]:
        corners, keys, _, _ = detector.detectBoard(grey)
        if keys is None:
            return []
        pixels = np.reshape(corners, (-1, 2))
        return [((-1, int(key)), (float(x) + 0.5, float(y) + 0.5)) for key, (x, y) in zip(np.ravel(keys), pixels)]

    return detect


def _board(markers: dict[str, Any]) -> Any:
    import cv2

    columns, rows = markers["board"]
    dictionary = _dictionary(markers["dictionary"])
    return cv2.aruco.CharucoBoard((columns, rows), markers["square"], markers["size"], dictionary)


def _dictionary(name: str) -> Any:
    import cv2

    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))


def locate(spot: Spot, model: SparseModel) -> Array:
    """Return the position in the world of what photos see, (3,) float64; NaN where fewer than two of them agree."""
    images = [image for image in model.images if image.name in spot.seen]
    if len(images) < 2:
        return np.full(3, np.nan)
    poses = np.array([image.cam_from_world for image in images])
    seen = np.array([_direction(image, model, spot.seen[image.name]) for image in images])
    focal = float(np.median([model.lenses[image.lens].K[0, 0] for image in images]))
    point, kept = triangulate_agreed(poses, seen, AGREE / focal)
    if np.isnan(point).any() or _widest(point, poses[kept]) < 1.0:
        return np.full(3, np.nan)
    return np.asarray(point)


def _direction(image: ModelImage, model: SparseModel, pixel: tuple[float, float]) -> Array:
    return directions_of(model.lenses[image.lens], np.array([pixel]))[0]


def _widest(point: Array, poses: Array) -> float:
    """Largest angle in degrees under which two of the cameras meet at a point."""
    towards = -np.einsum("nji,nj->ni", poses[:, :, :3], poses[:, :, 3]) - point
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    return float(np.degrees(np.arccos(np.clip((towards @ towards.T).min(), -1.0, 1.0))))


def marker_similarity(
    photos: Sequence[PhotoEntry], markers: dict[str, Any], model: SparseModel
) -> tuple[tuple[float, Array, Array], float, str]:
    """Find the similarity that takes a model to the world of its markers.

    Returns
    -------
    similarity : (scale, R, t)
    rms : float
        Of the corners' distances from where they should be, scene units.
    words : str
        What was found.

    Raises
    ------
    CaptureError
        Too few corners were found.
    """
    spots = find_corners(photos, markers)
    positions = {corner: locate(spot, model) for corner, spot in spots.items()}
    positions = {corner: each for corner, each in positions.items() if np.isfinite(each).all()}
    if markers["board"]:
        return _by_board(photos, markers, positions)
    return _by_markers(photos, markers, positions)


def _by_board(
    photos: Sequence[PhotoEntry], markers: dict[str, Any], positions: dict[Corner, Array]
) -> tuple[tuple[float, Array, Array], float, str]:
    height = markers["board"][1] * markers["square"]
    known = np.array(_board(markers).getChessboardCorners(), np.float64) * (1.0, -1.0, 1.0) + (0.0, height, 0.0)
    found = np.array(list(positions.values())).reshape(-1, 3)
    if len(found) < 4 or spread(found) < 0.05:
        raise CaptureError(_missing(photos, markers, f"{len(found)} corners of the board"))
    wanted = known[[corner for _, corner in positions]]
    similarity = fit_points(found, wanted)
    rms = _rms(similarity, found, wanted)
    return similarity, rms, f"{len(found)} corners of the board"


def _by_markers(
    photos: Sequence[PhotoEntry], markers: dict[str, Any], positions: dict[Corner, Array]
) -> tuple[tuple[float, Array, Array], float, str]:
    keys = sorted({key for key, _ in positions})
    whole = [key for key in keys if all((key, corner) in positions for corner in range(4))]
    frame = whole[0] if markers["frame"] is None and whole else markers["frame"]
    if frame not in whole:
        named = "any marker" if markers["frame"] is None else f"marker {markers['frame']}"
        raise CaptureError(_missing(photos, markers, f"not {named}, but {keys or 'none'}"))
    squares = {key: np.array([positions[key, corner] for corner in range(4)]) for key in whole}
    edges = [np.linalg.norm(four - np.roll(four, -1, axis=0), axis=1) for four in squares.values()]
    scale = markers["size"] / float(np.median(edges))
    half = markers["size"] / 2.0
    wanted = np.array([[-half, half, 0], [half, half, 0], [half, -half, 0], [-half, -half, 0]])
    _, R, _ = fit_points(squares[frame], wanted)
    t = -scale * (R @ squares[frame].mean(axis=0))
    rms = _rms((scale, R, t), squares[frame], wanted)
    return (scale, R, t), rms, f"markers {', '.join(map(str, whole))}, with marker {frame} as the origin"


def _rms(similarity: tuple[float, Array, Array], found: Array, wanted: Array) -> float:
    off = move_points(similarity, found) - wanted
    return float(np.sqrt((off**2).sum(axis=1).mean()))


def _missing(photos: Sequence[PhotoEntry], markers: dict[str, Any], found: str) -> str:
    where = Path(photos[0].image).parent
    return (
        f"{where}: markers of {markers['dictionary']} are not seen well enough: found {found}; each has to be whole "
        "and sharp in two photos or more that were calibrated. Check calibrate.markers, or set calibrate.align: none"
    )
