"""nerfstudio (and Blender/instant-ngp style) ``transforms.json`` as lenses and poses.

Blender's synthetic scenes come as ``transforms_train.json``, ``transforms_val.json`` and ``transforms_test.json``.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ibrpipe.errors import CaptureError, FormatError
from ibrpipe.io.cameras.shots import CameraSet, PhotoFolder, Shot
from ibrpipe.io.cameras.transforms_lens import frame_keys, frame_lens
from ibrpipe.io.untrusted.boundary import reader, reason, utf8_text
from ibrpipe.types import Array, Camera

TRANSFORMS = "transforms.json"
#: Blender's, what photos are made from and what they are measured on; those of transforms_val.json are left out
BLENDER_TRAIN, BLENDER_TEST, BLENDER_VAL = (f"transforms_{name}.json" for name in ("train", "test", "val"))
#: OpenCV camera axes (x right, y down, z forward) from OpenGL's (x right, y up, z backward)
OPENCV_FROM_OPENGL = np.diag([1.0, -1.0, -1.0])
#: What names without a suffix stand for, best first
_IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".exr", ".tif", ".tiff")


@reader("write it again")
def read_transforms(path: Path) -> tuple[tuple[Shot, ...], Path | None]:
    """Read all photos of a ``transforms.json``, those held out among them, and the file it names as surface.

    Parameters
    ----------
    path : Path

    Returns
    -------
    shots : tuple of Shot
        Sorted by name.
    mesh : Path or None
        What ``ply_file_path`` names (nerfstudio writes point clouds there too: it may hold no faces).

    Raises
    ------
    FormatError, CaptureError
        Not JSON, keys missing, an unknown camera model, a pose that is no rigid motion.
    """
    document = _document(path)
    return _sorted(_shots(document, path)), _named_mesh(document, path)


@reader("write it again")
def read_nerfstudio(path: Path) -> CameraSet:
    """Read a ``transforms.json`` with its split: what ``test_filenames`` names is held out, else ``val_filenames``.

    Raises
    ------
    as `read_transforms`

    Notes
    -----
    ``transform_matrix`` is world-from-camera with OpenGL camera axes; the world's own axes are kept as they are.
    """
    document = _document(path)
    shots = _shots(document, path)
    lists = {name: _split_list(document, f"{name}_filenames", path) for name in ("train", "val", "test")}
    mesh, warnings = _named_mesh(document, path), _unused(document, path)
    if not any(lists.values()):
        return CameraSet(_sorted(shots), mesh=mesh, warnings=tuple(warnings))
    kind = "test" if lists["test"] else "val"
    named = {shot.image: frame["file_path"] for shot, frame in zip(shots, document["frames"])}
    keys = {shot: {_key(shot.file), _key(named[shot.image])} for shot in shots}
    held = [shot for shot in shots if keys[shot] & lists[kind]]
    train = [shot for shot in shots if shot not in held and (not lists["train"] or keys[shot] & lists["train"])]
    known = set().union(*keys.values())
    notes = []
    if held:
        notes.append(f"{len(held)} photos are held out for measuring, as {kind}_filenames of {path.name} says")
    unknown = sum(name not in known for names in lists.values() for name in names)
    if unknown:
        warnings.append(f"{path.name}: {unknown} names in its lists of files are no photos of its frames")
    left = [shot for shot in shots if shot not in held and shot not in train]
    if left:
        text = f"{path.name}: {len(left)} of {len(shots)} photos are neither in train_filenames nor in {kind}_filenames"
        warnings.append(f"{text} and are left out, the first is {left[0].file}")
    return CameraSet(_sorted(train), _sorted(held), mesh, tuple(notes), tuple(warnings))


def read_blender(root: Path) -> CameraSet:
    """Read the three files of a synthetic scene of Blender: train to build from, test held out, val left out."""
    train, test = root / BLENDER_TRAIN, root / BLENDER_TEST
    document = _document(train)
    held = _shots(_document(test), test) if test.is_file() else []
    notes = [f"cameras are those of {train.name}"]
    if held:
        notes.append(f"{len(held)} photos are held out for measuring, those of {test.name}")
    if (root / BLENDER_VAL).is_file():
        notes.append(f"the photos of {BLENDER_VAL} are not used")
    shots = _sorted(_shots(document, train))
    return CameraSet(shots, _sorted(held), _named_mesh(document, train), tuple(notes))


def pose_from_opengl(world_from_camera: Array) -> Array:
    """Turn a (4, 4) or (3, 4) OpenGL camera-to-world matrix into (3, 4) OpenCV ``cam_from_world``.

    Raises
    ------
    CaptureError
        NaN, or a rotation part off by more than 1e-3 (scaled, sheared, mirrored or singular).
    """
    matrix = np.asarray(world_from_camera, np.float64)
    if matrix.shape not in ((4, 4), (3, 4)):
        raise CaptureError(f"transform_matrix must be 4 x 4, got shape {matrix.shape}")
    if not np.isfinite(matrix).all():
        raise CaptureError("transform_matrix holds NaN or infinity; calibrate this photo again or remove it")
    rotation = matrix[:3, :3]
    off = np.abs(rotation.T @ rotation - np.eye(3)).max()
    if off > 1e-3 or np.linalg.det(rotation) < 0:
        raise CaptureError(
            f"transform_matrix is no rigid motion (determinant {np.linalg.det(rotation):.4g}, expected 1); "
            "remove scale and mirroring from it"
        )
    left, _, right = np.linalg.svd(rotation)
    rotation = OPENCV_FROM_OPENGL @ (left @ right).T
    return np.concatenate([rotation, -(rotation @ matrix[:3, 3])[:, None]], axis=1)


def opengl_pose(camera: Camera) -> list[list[float]]:
    """Return the ``transform_matrix`` (4, 4) of a camera: camera to world in OpenGL's axes, y up and z backwards."""
    matrix = np.eye(4)
    matrix[:3, :3] = camera.R.T @ OPENCV_FROM_OPENGL
    matrix[:3, 3] = camera.center
    return [[float(value) for value in row] for row in matrix]


def _sorted(shots: list[Shot]) -> tuple[Shot, ...]:
    return tuple(sorted(shots, key=lambda shot: shot.file))


def _document(path: Path) -> Mapping[str, Any]:
    try:
        document = json.loads(utf8_text(path, "write it again"))
    except (ValueError, RecursionError) as error:
        if isinstance(error, FormatError):
            raise
        raise FormatError(f"{path}: is not JSON ({reason(error)}); write it again") from error
    if not isinstance(document, dict):
        raise FormatError(f"{path}: expected a JSON object with 'frames', got {type(document).__name__}")
    return document


def _named_mesh(document: Mapping[str, Any], path: Path) -> Path | None:
    ply = document.get("ply_file_path")
    if not isinstance(ply, str) or not ply:
        return None
    return PhotoFolder(path.parent).at(ply, path) or path.parent / ply


def _unused(document: Mapping[str, Any], path: Path) -> list[str]:
    """Tell of depth maps that frames name."""
    keys = ("depth_file_path", "depth_path")
    count = sum(any(key in frame for key in keys) for frame in document["frames"])
    text = (
        f"{path.name}: {count} frames name depth maps, which are not used: put them into depth/, called as the photos"
    )
    return [text] if count else []


def _split_list(document: Mapping[str, Any], key: str, path: Path) -> set[str]:
    names = document.get(key) or []
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise FormatError(f"{path}: {key} is no list of file names; write it again or remove it")
    return {_key(name) for name in names}


def _key(name: str) -> str:
    """A photo's name as far as it tells photos apart: lists and frames write slashes, ./ and images/ differently."""
    return name.replace("\\", "/").removeprefix("./").removeprefix("images/").casefold()


def _shots(document: Mapping[str, Any], path: Path) -> list[Shot]:
    frames = document.get("frames")
    if not isinstance(frames, list) or not frames:
        raise FormatError(
            f"{path}: has no list 'frames'; expected a nerfstudio transforms.json with one entry per photo"
        )
    files = PhotoFolder(path.parent), PhotoFolder(path.parent / "images")
    return [_shot(frame, document, path, index, files) for index, frame in enumerate(frames)]


def _shot(
    frame: Any, document: Mapping[str, Any], path: Path, index: int, files: tuple[PhotoFolder, PhotoFolder]
) -> Shot:
    if not isinstance(frame, dict) or not isinstance(frame.get("file_path"), str):
        raise FormatError(f"{path}: frame {index} has no 'file_path'; every frame names its photo")
    where = f"{path}: frame {index} ({frame['file_path']})"
    if "transform_matrix" not in frame:
        raise FormatError(f"{where}: has no 'transform_matrix'; every frame states its pose")
    image = _image_path(path, frame["file_path"], files)
    try:
        pose = pose_from_opengl(np.array(frame["transform_matrix"], np.float64))
        lens = frame_lens(frame_keys(frame, document), image)
    except CaptureError as error:
        raise CaptureError(f"{where}: {error}") from error
    except (ValueError, TypeError, ArithmeticError) as error:
        raise FormatError(f"{where}: {error}") from error
    mask = frame.get("mask_path")
    named = isinstance(mask, str) and bool(mask)
    return Shot(_file(image, path.parent), image, lens, pose, _named_file(path, str(mask), files[0]) if named else None)


def _image_path(path: Path, name: str, files: tuple[PhotoFolder, PhotoFolder]) -> Path:
    """The photo's path; Blender-style names leave out the suffix."""
    found = files[0].at(name, path, _IMAGE_SUFFIXES) or files[1].find(name, path)
    if found is not None:
        return found
    image = path.parent / name.replace("\\", "/")
    return image if image.suffix.lower() in _IMAGE_SUFFIXES else Path(f"{image}.png")


def _named_file(path: Path, name: str, files: PhotoFolder) -> Path:
    return files.at(name, path, _IMAGE_SUFFIXES) or path.parent / name.replace("\\", "/")


def _file(image: Path, root: Path) -> str:
    """Name of a photo below images/, or below the capture where it lies elsewhere in it."""
    for folder in (root / "images", root):
        if image.is_relative_to(folder) and ".." not in image.relative_to(folder).parts:
            return image.relative_to(folder).as_posix()
    return image.name
