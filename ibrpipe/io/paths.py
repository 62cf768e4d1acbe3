"""Camera paths: named cameras from a COLMAP model, a transforms.json, the views of a capture, or an orbit.

A path is written as one text:

- ``test``, ``train``, ``all``: the views of the capture itself; ``test`` where nothing is held out: some of the photos;
- a folder that holds a COLMAP model (or a capture folder with one), or a ``transforms.json``;
- ``orbit`` or ``orbit:frames=120,elevation=20,fov=40``: a circle around the asset (`OrbitSpec` lists the keys).
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from ibrpipe.errors import ConfigError, MissingFileError
from ibrpipe.io.manifest import digest
from ibrpipe.io.views import ViewSet
from ibrpipe.types import Array, Asset, Camera

#: A camera path: file-name stem and camera of every frame, in order
CameraPath = tuple[tuple[str, Camera], ...]

#: Letters of a camera path that the folder of its frames is called by; longer ones end in a hash
_LONGEST_NAME = 80
#: Paths that are views of the capture itself
OWN_PATHS = ("test", "train", "all")
_KINDS: dict[str, Callable[[str], Any]] = {"int": int, "float": float, "str": str}
_UPS = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
#: An estimated up direction closer to a world axis than this, degrees, is that axis
_NEAR_AXIS = 10.0


@dataclass(frozen=True)
class OrbitSpec:
    """A circle of cameras that look at the middle of the asset.

    Attributes
    ----------
    frames : number of frames
    elevation : degrees above the horizon
    azimuth : degrees of the first frame; 0 faces the side from which most photos were taken
    sweep : degrees travelled; 360 closes the circle
    distance : from the middle, scene units; 0 = so far that the box around the asset just fits into every frame
    fov : vertical field of view in degrees
    width, height : pixels; 0 = those of the capture's first photo, else 640 x 480
    up : "x", "y", "z", "-x", "-y", "-z", or "auto" = from how the photos were held
    """

    frames: int = 120
    elevation: float = 20.0
    azimuth: float = 0.0
    sweep: float = 360.0
    distance: float = 0.0
    fov: float = 40.0
    width: int = 0
    height: int = 0
    up: str = "auto"

    def __post_init__(self) -> None:
        checks = (
            ("frames", 1 <= self.frames <= 100_000, "1 to 100000"),
            ("elevation", -90 <= self.elevation <= 90, "-90 to 90 degrees"),
            ("azimuth", math.isfinite(self.azimuth), "finite degrees"),
            ("sweep", math.isfinite(self.sweep), "finite degrees"),
            ("distance", 0 <= self.distance < math.inf, "0 (fitting) or more"),
            ("fov", 0 < self.fov < 170, "more than 0 and less than 170 degrees"),
            ("width", 0 <= self.width <= 65536, "0 to 65536 pixels"),
            ("height", 0 <= self.height <= 65536, "0 to 65536 pixels"),
            ("up", self.up == "auto" or self.up.removeprefix("-") in _UPS, "auto, x, y, z, -x, -y or -z"),
        )
        for name, valid, expected in checks:
            if not valid:
                raise ConfigError(f"orbit: {name} is {getattr(self, name)}; expected {expected}")


def frames_folder(usual: str, path: str, path_of_run: str) -> str:
    """Return the name of the folder for the frames of a camera path.

    Parameters
    ----------
    usual : str
        Folder of the frames of the run's own path.
    path, path_of_run : str
        The path that is asked for, and the run's own.
    """
    if path == path_of_run:
        return usual
    name = re.sub(r"[^\w.,=-]+", "-", path).strip("-.")
    if len(name) > _LONGEST_NAME:
        name = f"{name[:_LONGEST_NAME]}-{digest(path)[:8]}"
    return f"{usual}-{name}"


def is_orbit(text: str) -> bool:
    """Say whether a path is an orbit."""
    return text.partition(":")[0] == "orbit"


def parse_orbit(text: str) -> OrbitSpec:
    """Read ``orbit`` or ``orbit:key=value,...``.

    Raises
    ------
    ConfigError
        A key is unknown, a value is no number or out of range.
    """
    kinds = {field.name: _KINDS[str(field.type)] for field in fields(OrbitSpec)}
    values: dict[str, Any] = {}
    for part in filter(None, text.partition(":")[2].split(",")):
        key, equals, value = (piece.strip() for piece in part.partition("="))
        if not equals or key not in kinds:
            raise ConfigError(f"orbit: {part.strip()!r} is not understood; expected key=value with {', '.join(kinds)}")
        try:
            values[key] = kinds[key](value)
        except ValueError as error:
            raise ConfigError(f"orbit: {key} is {value!r}; expected a number") from error
    return OrbitSpec(**values)


def orbit(spec: OrbitSpec, bounds: tuple[Array, Array], photos: Sequence[Camera] = ()) -> CameraPath:
    """Cameras on a circle around a box.

    Parameters
    ----------
    spec : OrbitSpec
    bounds : (3,), (3,) float
        Lowest and highest corner of what is looked at, world.
    photos : sequence of Camera
        They decide which way is up, where azimuth 0 is, and the default size.
    """
    low, high = (np.asarray(corner, np.float64) for corner in bounds)
    middle = 0.5 * (low + high)
    up = _up(spec.up, photos)
    front = _front(middle, up, photos)
    side = np.cross(up, front)
    steps = spec.frames if abs(spec.sweep) >= 360.0 else max(spec.frames - 1, 1)
    azimuths = np.radians(spec.azimuth + spec.sweep / steps * np.arange(spec.frames))
    rise = math.radians(spec.elevation)
    around = np.cos(azimuths)[:, None] * front + np.sin(azimuths)[:, None] * side
    size = (spec.width or (photos[0].width if photos else 640), spec.height or (photos[0].height if photos else 480))

    def look(distance: float) -> list[Camera]:
        eyes = middle + distance * (math.cos(rise) * around + math.sin(rise) * up)
        return [Camera.look_at(eye, middle, _tilted(up, front, spec), spec.fov, *size) for eye in eyes]

    cameras = look(spec.distance or _fitting_distance(look(1.0), low, high))
    return tuple((f"orbit_{index:04d}", camera) for index, camera in enumerate(cameras))


def _fitting_distance(cameras: Sequence[Camera], low: Array, high: Array) -> float:
    """Smallest distance at which cameras that look at a box's middle show all of it, with a margin of 5 percent."""
    corners = np.stack(np.meshgrid(*zip(low, high)), axis=-1).reshape(-1, 3) - 0.5 * (low + high)
    distance = 0.0
    for camera in cameras:
        local = corners @ camera.R.T
        half = 0.95 * 0.5 * np.array([camera.width / camera.K[0, 0], camera.height / camera.K[1, 1]])
        distance = max(distance, float((np.abs(local[:, :2]) / half - local[:, 2:]).max()))
    return distance or 1.0


def _tilted(up: Array, front: Array, spec: OrbitSpec) -> Array:
    """Up vector for `Camera.look_at`; straight above or below it must not be the line of sight."""
    return up if abs(spec.elevation) < 89.99 else -np.sign(spec.elevation) * front


def up_of(photos: Sequence[Camera], near: float) -> Array:
    """Return what is up, (3,) float64: as most photos stand, the axis within `near` degrees of it; without any, z."""
    mean = -np.mean([camera.R[1] for camera in photos], axis=0) if photos else np.zeros(3)
    length = float(np.linalg.norm(mean))
    if length < 0.1:
        return np.array(_UPS["z"])
    axis = np.zeros(3)
    largest = int(np.abs(mean).argmax())
    axis[largest] = np.sign(mean[largest])
    return axis if abs(mean[largest]) > math.cos(math.radians(near)) * length else mean / length


def _up(name: str, photos: Sequence[Camera]) -> Array:
    """Unit vector that is up: a named axis, or as the photos stand."""
    if name == "auto":
        return up_of(photos, _NEAR_AXIS)
    return (-1.0 if name.startswith("-") else 1.0) * np.array(_UPS[name.removeprefix("-")])


def _front(middle: Array, up: Array, photos: Sequence[Camera]) -> Array:
    """Horizontal unit vector towards the photos' mean position; any one where they surround the middle."""
    mean = np.mean([camera.center - middle for camera in photos], axis=0) if photos else np.zeros(3)
    reach = max((float(np.linalg.norm(camera.center - middle)) for camera in photos), default=1.0)
    flat = mean - (mean @ up) * up
    if np.linalg.norm(flat) < 0.1 * reach:
        flat = np.eye(3)[(int(np.abs(up).argmax()) + 1) % 3]
        flat = flat - (flat @ up) * up
    return flat / np.linalg.norm(flat)


def read_path(path: Path) -> CameraPath:
    """Cameras of a COLMAP model folder (or a capture folder that holds one) or of a ``transforms.json``.

    Distorted cameras come back as the pinhole cameras that replace them, as `ibrpipe ingest` does.

    Raises
    ------
    MissingFileError, FormatError, CaptureError
        Nothing is there, or it is not what it should be.
    """
    from ibrpipe.io.cameras.colmap import find_model, read_model
    from ibrpipe.io.cameras.lenses import undistorted_calibration
    from ibrpipe.io.cameras.transforms import read_transforms

    if path.is_file():
        shots, _ = read_transforms(path)
    elif path.is_dir():
        model = path if _holds_model(path) else find_model(path)
        transforms = path / "transforms.json"
        if model is None and not transforms.is_file():
            raise MissingFileError(f"{path}: holds neither a COLMAP model (images.bin, images.txt) nor transforms.json")
        shots = read_model(model, path / "images") if model else read_transforms(transforms)[0]
    else:
        raise MissingFileError(
            f"{path}: there is no such camera path; give {', '.join(OWN_PATHS)}, orbit, a folder or a file"
        )
    return tuple(
        (_stem(shot.file), Camera(K, shot.cam_from_world, width, height))
        for shot in shots
        for K, width, height in [undistorted_calibration(shot.lens)]
    )


def _holds_model(folder: Path) -> bool:
    return any((folder / f"images{suffix}").is_file() for suffix in (".bin", ".txt"))


def _stem(file: str) -> str:
    """File name of a frame: folders become part of the name."""
    return Path(file).with_suffix("").as_posix().strip("/").replace("/", "_").replace("\\", "_")


def camera_path(text: str, asset: Asset, views: ViewSet) -> CameraPath:
    """Return the cameras that `text` means (see `ibrpipe.io.paths`).

    Raises
    ------
    ConfigError
        The path has no camera.
    """
    own = {"test": views.shown, "train": views.train, "all": (*views.train, *views.test)}
    if text in own:
        path: CameraPath = tuple((view.name, view.camera) for view in own[text])
    elif is_orbit(text):
        photos = [view.camera for view in (*views.train, *views.test)]
        path = orbit(parse_orbit(text), asset.bounds, photos)
    else:
        path = read_path(Path(text))
    if not path:
        raise ConfigError(
            f"render: the path {text!r} has no camera: no photo of the asset is known; choose orbit, or give --views"
        )
    return path
