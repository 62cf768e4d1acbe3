"""The photos of a capture and what it states of their cameras, as entries of a job."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from ibrpipe.calibration.job import PhotoEntry
from ibrpipe.errors import CaptureError, MissingFileError
from ibrpipe.io.cameras.shots import PHOTO_SUFFIXES, Shot, photo_root
from ibrpipe.io.cameras.sources import has_cameras, has_test
from ibrpipe.io.captures import read_shots
from ibrpipe.io.manifest import files_below
from ibrpipe.io.photos.extra_formats import without_raw_twins
from ibrpipe.io.photos.image_files import read_header
from ibrpipe.io.photos.masks import MaskChoice, MaskedPhoto, find_masks
from ibrpipe.io.videos.read import is_video

#: folders of a capture that hold pictures which are no photos, or are photos of another kind
BESIDE_PHOTOS = ("test", "masks", "depth", "depths", "sparse", "dense", "light")


def photos_of(root: Path) -> tuple[PhotoEntry, ...]:
    """List all photos below ``images/`` and ``test/images/``, with what is known of their cameras.

    Without ``images/`` the folder itself is that of the photos, but for its masks, depth maps and the like, and for
    run folders in it.

    Parameters
    ----------
    root : Path
        Capture folder.

    Returns
    -------
    tuple of PhotoEntry
        In the order of their names, those of ``test/`` last. Photos that given cameras leave out are listed, too.

    Raises
    ------
    MissingFileError, CaptureError, FormatError
        No photos, or cameras that cannot be read.
    """
    found = _half(root)
    if not found and root.is_dir() and any(map(is_video, files_below(photo_root(root)))):
        raise CaptureError(f"{root}: holds videos and no photos; `ibrpipe run {root}` takes photos from them")
    if not found:
        raise CaptureError(
            f"{root}: no photos found; expected JPEG, PNG, TIFF or EXR files in it or in its images/, put them there"
        )
    if has_test(root):
        found += [replace(entry, name=f"test/{entry.name}", held_out=True) for entry in _half(root / "test")]
    return tuple(found)


def _half(root: Path) -> list[PhotoEntry]:
    shots = {shot.file: shot for shot in (read_shots(root) if has_cameras(root) else ())}
    for shot in shots.values():
        if not shot.image.is_file():
            raise MissingFileError(f"{shot.image}: the photo does not exist, but the capture's cameras name it")
    folder = photo_root(root)
    images = {file.relative_to(folder).as_posix(): file for file in photo_files(folder)}
    if folder == root:
        images = {name: file for name, file in images.items() if name.split("/")[0] not in BESIDE_PHOTOS}
    images |= {name: shot.image for name, shot in shots.items()}
    names = sorted(images)
    named = {name: shot.mask for name, shot in shots.items()}
    photos = [MaskedPhoto(n, images[n], named.get(n), read_header(images[n]).has_alpha) for n in names]
    entries = [_entry(photo, mask) for photo, mask in zip(photos, find_masks(root, photos)[0])]
    return [_with_camera(entry, shots[name]) if name in shots else entry for name, entry in zip(names, entries)]


def photo_files(folder: Path) -> list[Path]:
    """Return the photos below a folder, sorted; masks, and raw files of photos that are there, are left out."""
    if not folder.is_dir():
        return []
    found = (path for path in files_below(folder) if path.suffix.lower() in PHOTO_SUFFIXES and path.is_file())
    return sorted(without_raw_twins(path for path in found if not path.name.endswith(".mask.png")))


def _entry(photo: MaskedPhoto, mask: MaskChoice) -> PhotoEntry:
    stored = None if mask.file is None else str(mask.file.resolve())
    return PhotoEntry(photo.file, str(photo.image.resolve()), stored, mask.from_alpha, mask.rule)


def _with_camera(entry: PhotoEntry, shot: Shot) -> PhotoEntry:
    lens = shot.lens
    pose = tuple(float(value) for value in np.ravel(shot.cam_from_world))
    return replace(entry, lens=(lens.model, lens.params, lens.width, lens.height), pose=pose)


def without_cameras(photos: Sequence[PhotoEntry], keep_lenses: bool) -> tuple[PhotoEntry, ...]:
    """Forget lenses unless they are to be kept. Poses stay: they place the world, they do not enter the search."""
    return tuple(photos) if keep_lenses else tuple(replace(photo, lens=None) for photo in photos)
