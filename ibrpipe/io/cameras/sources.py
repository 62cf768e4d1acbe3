"""Which of a capture's camera files counts, and what the others would have told."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from ibrpipe.errors import CaptureError, IbrError
from ibrpipe.io.cameras.bundler import BUNDLER, LIST, read_bundler
from ibrpipe.io.cameras.colmap import FOLDERS, find_model, find_models, image_count, read_model
from ibrpipe.io.cameras.metashape import METASHAPE, read_metashape
from ibrpipe.io.cameras.middlebury import CALIBRATION, is_stereo, read_stereo
from ibrpipe.io.cameras.shots import CameraSet, PhotoFolder, Shot, name_below, photo_root
from ibrpipe.io.cameras.transforms import BLENDER_TEST, BLENDER_TRAIN, TRANSFORMS, read_blender, read_nerfstudio

#: Camera files beside COLMAP's models, best first
CAMERA_FILES = (TRANSFORMS, BLENDER_TRAIN, METASHAPE, BUNDLER)


def camera_files(root: Path) -> list[Path]:
    """Return the files and folders of a capture folder, or of its ``test/``, that cameras are read from."""
    names = (*CAMERA_FILES, BLENDER_TEST, LIST, CALIBRATION)
    found = [root / name for name in names]
    for folder in (root / name for name in FOLDERS):
        found += [folder, *sorted(folder.glob("*")), *sorted(folder.glob("*/*"))]
    return [path for path in found if path.exists()]


def has_cameras(root: Path) -> bool:
    """Say whether a capture folder, or its ``test/``, states cameras."""
    found = find_model(root) is not None or any((root / name).is_file() for name in CAMERA_FILES)
    return found or is_stereo(root)


def has_test(root: Path) -> bool:
    """Say whether a capture folder has a ``test/`` that is a capture of its own, not only photos its cameras name."""
    test = root / "test"
    if not test.is_dir():
        return False
    named = any((root / name).is_file() for name in (TRANSFORMS, BLENDER_TRAIN))
    return has_cameras(test) or (test / "images").is_dir() or not named


def read_cameras(root: Path, model: Path | None) -> CameraSet:
    """Read the cameras of a folder: those of a COLMAP model if there is one, else of the first file that exists.

    Parameters
    ----------
    root : Path
    model : Path or None
        Folder of the COLMAP model; it may lie elsewhere.

    Raises
    ------
    CaptureError, FormatError, MissingFileError
        No cameras, or none that can be read.
    """
    found = _read(root, model)
    there = [name for name in CAMERA_FILES if (root / name).is_file()]
    unused = [name for name in there if name != TRANSFORMS] if model is not None else there[1:]
    if not unused:
        return found
    note = f"{' and '.join(unused)} is not used: cameras are those of {'COLMAP' if model is not None else there[0]}"
    return replace(found, notes=(*found.notes, note))


def _read(root: Path, model: Path | None) -> CameraSet:
    if model is not None:
        return _of_model(root, model)
    if (root / TRANSFORMS).is_file():
        return read_nerfstudio(root / TRANSFORMS)
    if (root / BLENDER_TRAIN).is_file():
        return read_blender(root)
    if (root / METASHAPE).is_file():
        return read_metashape(root / METASHAPE, photo_root(root))
    if (root / BUNDLER).is_file():
        return read_bundler(root / BUNDLER, photo_root(root))
    if is_stereo(root):
        return CameraSet(read_stereo(root))
    raise CaptureError(
        f"{root}: no cameras found; expected a COLMAP model in sparse/0, {TRANSFORMS}, {BLENDER_TRAIN}, {METASHAPE} or "
        f"{BUNDLER} (`ibrpipe calibrate` finds them from the photos alone)"
    )


def _of_model(root: Path, model: Path) -> CameraSet:
    images = photo_root(root)
    photos = PhotoFolder(images)
    shots = tuple(_found(shot, photos, model) for shot in read_model(model, images))
    warnings = []
    others = [each for each in find_models(root) if each != model] if model.is_relative_to(root) else []
    if others:
        counts = ", ".join(f"{each.relative_to(root).as_posix()} ({image_count(each)} photos)" for each in others)
        warnings.append(
            f"several COLMAP models: {model.relative_to(root).as_posix()} ({len(shots)} photos) is used, the largest; "
            f"{counts} not: merge them (colmap model_merger), or calibrate all photos anew"
        )
    found = CameraSet(tuple(sorted(shots, key=lambda shot: shot.file)), warnings=tuple(warnings))
    return _joined(found, root, model) if (root / TRANSFORMS).is_file() else found


def _found(shot: Shot, photos: PhotoFolder, model: Path) -> Shot:
    """Find a photo whose name differs from the disk's in case, slashes or leading folders."""
    image = photos.of_model(shot.file, model)
    if image is None or image == shot.image:
        return shot
    return replace(shot, image=image, file=name_below(image, photos.root))


def _joined(cameras: CameraSet, root: Path, model: Path) -> CameraSet:
    """Take from ``transforms.json`` what a COLMAP model does not state: masks, held-out photos, surface."""
    try:
        other = read_nerfstudio(root / TRANSFORMS)
    except IbrError as error:
        return replace(cameras, warnings=(*cameras.warnings, f"{TRANSFORMS} is not used: {error}"))
    named = {shot.image: shot for shot in (*other.shots, *other.held_out)}
    shots = tuple(_with_mask(shot, named.get(shot.image)) for shot in cameras.shots)
    held = {shot.image for shot in other.held_out}
    kept = tuple(shot for shot in shots if shot.image in held)
    masks = sum(shot.mask is not None for shot in shots)
    taken = [f"masks of {masks} photos"] if masks else []
    taken += [f"{len(kept)} photos to hold out"] if kept else []
    inside = model.is_relative_to(root)
    told = f"cameras are those of {model.relative_to(root).as_posix() if inside else model}"
    told += f", {TRANSFORMS} gives {' and '.join(taken)}" if taken else f", not those of {TRANSFORMS}"
    fits = _agree(shots, [named.get(shot.image) for shot in shots])
    notes, warnings = list(cameras.notes), list(cameras.warnings)
    if inside and not fits:
        warnings.append(f"{told}; the two place photos in different worlds: a mesh must be in that of the first")
    elif kept:
        notes.append(told)
    lost = sorted({shot.file for shot in named.values()} - {shot.file for shot in shots})
    if inside and lost:
        text = f"{len(lost)} photos of {TRANSFORMS} are not in {model.relative_to(root).as_posix()} and are left out"
        warnings.append(f"{text}, the first is {lost[0]}")
    train = tuple(shot for shot in shots if shot.image not in held)
    mesh = other.mesh if fits or not inside else None
    return CameraSet(train, kept, mesh, tuple(notes), (*warnings, *other.warnings))


def _with_mask(shot: Shot, other: Shot | None) -> Shot:
    there = other is not None and other.mask is not None and other.mask.is_file()
    return replace(shot, mask=other.mask) if other is not None and there else shot


def _agree(shots: Sequence[Shot], others: Sequence[Shot | None]) -> bool:
    """Whether two sources place the photos that they share alike."""
    pairs = [(one.cam_from_world, two.cam_from_world) for one, two in zip(shots, others) if two is not None]
    if not pairs:
        return False
    one, two = (np.array(side) for side in zip(*pairs))
    scale = max(float(np.abs(one[:, :, 3]).max()), 1e-12)
    off = np.abs(one - two)
    return bool(off[:, :, :3].max() < 1e-3 and off[:, :, 3].max() < 1e-3 * scale)
