"""Capture folders: photos, cameras, masks, exposure and mesh, found and checked against each other.

Layout: ``images/``, optional ``masks/``, ``sparse/0`` (COLMAP), ``transforms.json`` (nerfstudio), ``cameras.xml``
(Metashape), ``bundle.out`` (Bundler) or a Middlebury stereo pair (``calib.txt``, ``im0.png``, ``im1.png``), optional
``mesh.ply|obj|glb|stl``, optional ``exposure.csv``, optional ``test/`` laid out alike with ``depth/*.exr|npy``.
Cameras may also come from elsewhere: from the folder that the calibrate stage has written.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

from ibrpipe.errors import CaptureError, FormatError, IbrError, MissingFileError, ValueRangeError
from ibrpipe.io.cameras.colmap import find_model
from ibrpipe.io.cameras.lenses import Keep, undistorted_calibration
from ibrpipe.io.cameras.shots import PHOTO_SUFFIXES, CameraSet, Shot
from ibrpipe.io.cameras.sources import camera_files, has_test, read_cameras
from ibrpipe.io.cameras.sources import has_cameras as has_cameras
from ibrpipe.io.photos.exposure import (
    EXPOSURES,
    gains_from_csv,
    gains_from_exif,
    gains_from_partial_exif,
    read_exposure_csv,
)
from ibrpipe.io.photos.extra_formats import without_raw_twins
from ibrpipe.io.photos.image_files import ImageHeader, read_header
from ibrpipe.io.photos.masks import MaskChoice, MaskedPhoto, find_masks
from ibrpipe.io.surfaces.meshes import has_faces
from ibrpipe.io.surfaces.scene_files import SUFFIXES
from ibrpipe.io.untrusted.boundary import reader
from ibrpipe.io.untrusted.inside import leads_inside, shortened
from ibrpipe.io.views import View
from ibrpipe.types import Camera

Exposure = Literal["none", "exif", "csv", "auto"]
Orientation = Literal["auto", "apply", "ignore"]


@dataclass(frozen=True)
class CaptureOptions:
    """How a capture folder is read.

    Attributes
    ----------
    hold_out_every : int
        Without ``test/``, photos 0, n, 2n, ... by name are held out for measuring; 0 = none.
    exposure : {"auto", "csv", "exif", "none"}
        Where gains come from; "auto": ``exposure.csv`` if there, else EXIF if every photo has it, else none.
    orientation : {"auto", "apply", "ignore"}
        Orientation tags; "auto": as COLMAP and nerfstudio, pixels count as stored unless only the turned picture fits.
    keep : {"all", "inside"}
        What undistortion keeps.
    color_space : str or None
        Overrides what the photos declare.
    cameras : Path or None
        Folder whose ``sparse/0`` replaces the capture's cameras, and whose ``test/sparse/0`` those of ``test/``,
        where they exist.
    allow_outside : bool
        What the capture consists of may lie outside its folder: where links, absolute paths or ``..`` lead.
    """

    hold_out_every: int = 8
    exposure: Exposure = "auto"
    orientation: Orientation = "auto"
    keep: Keep = "all"
    color_space: str | None = None
    cameras: Path | None = None
    allow_outside: bool = False


@dataclass(frozen=True, eq=False)
class Capture:
    """A capture folder, read and checked for consistency; pixels are not loaded.

    Attributes
    ----------
    root : Path
    train, test : tuple of View
    mesh : Path or None
    model : Path or None
        Folder of the COLMAP model that the cameras of the photos (not those of ``test/``) come from; its sparse
        points may be of use.
    exposure : {"none", "exif", "csv"}
        Where the gains come from.
    notes : tuple of str
        What was found and decided that a reader should know.
    warnings : tuple of str
        What was left out, or does not fit together.
    """

    root: Path
    train: tuple[View, ...]
    test: tuple[View, ...]
    mesh: Path | None
    model: Path | None
    exposure: str
    notes: tuple[str, ...]
    warnings: tuple[str, ...] = ()

    def __repr__(self) -> str:
        """Return the folder's name, how many photos there are, and the mesh."""
        mesh = "no mesh" if self.mesh is None else self.mesh.name
        return f"Capture({self.root.name!r}, {len(self.train)} photos, {len(self.test)} held out, {mesh})"


@dataclass(frozen=True)
class _Told:
    """What is to be told of a capture, in the order in which it was found."""

    notes: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)

    def add(self, cameras: CameraSet) -> None:
        self.notes.extend(cameras.notes)
        self.warnings.extend(cameras.warnings)


@reader("mend the capture")
def read_capture(path: Path | str, options: CaptureOptions | None = None) -> Capture:
    """Read a capture folder.

    Parameters
    ----------
    path : Path or str
    options : CaptureOptions, optional

    Returns
    -------
    Capture

    Raises
    ------
    MissingFileError, FormatError, CaptureError
        One line that names the file, what is wrong, what is expected, and how many problems more there are.
    """
    root, options = Path(path), options or CaptureOptions()
    if not root.is_dir():
        raise MissingFileError(f"{root}: is no folder; give a capture folder with images/ and cameras")
    root = root.resolve()
    told = _Told()
    if not options.allow_outside:
        stated = [*camera_files(root), *camera_files(root / "test"), root / EXPOSURES]
        _check_inside(root, [path for path in stated if path.exists()])
    model, test_model = _models(root, options.cameras)
    cameras = read_cameras(root, model)
    told.add(cameras)
    shots, held = cameras.shots, cameras.held_out
    tests = read_cameras(root / "test", test_model) if has_test(root) else CameraSet(())
    told.add(tests)
    test_shots = tests.shots + tests.held_out
    if not options.allow_outside:
        _check_inside(root, [shot.image for shot in (*shots, *held, *test_shots)])
    told.warnings.extend([*_unposed(root, shots + held), *_unposed(root / "test", test_shots)])
    headers, held_headers, test_headers = _headers(shots), _headers(held), _headers(test_shots)
    gains, exposure = _gains(
        root, shots + held + test_shots, headers + held_headers + test_headers, options.exposure, told
    )
    count, rest = len(shots), len(shots) + len(held)
    own = _views(root, shots + held, headers + held_headers, gains[:rest], options, told)
    train, test = own[:count], own[count:]
    test += _views(root / "test", test_shots, test_headers, gains[rest:], options, told)
    if test:
        test = tuple(replace(view, held_out=True) for view in test)
    else:
        train, test = _split(train, options.hold_out_every, told.notes)
    mesh = _mesh(root, cameras.mesh, told, options.allow_outside)
    if not options.allow_outside:
        _check_inside(root, [file for view in (*train, *test) for file in (view.mask, view.depth) if file is not None])
    return Capture(root, train, test, mesh, model, exposure, tuple(told.notes), tuple(told.warnings))


def _check_inside(root: Path, files: Iterable[Path]) -> None:
    """Refuse files that a capture names, or that links in it lead to, outside its folder."""
    known: dict[Path, bool] = {}
    for file in files:
        if file.is_symlink() or file.parent not in known:
            known[file.parent] = leads_inside(root, file.parent)
            if not (known[file.parent] and leads_inside(root, file)):
                raise CaptureError(
                    f"{shortened(str(file))}: lies outside the capture {root}; copy it there, or say that such files "
                    "may be used: ingest.allow_outside=true in a run, --allow-outside of view"
                )


@reader("mend the capture")
def read_shots(root: Path) -> tuple[Shot, ...]:
    """Read the cameras that a capture folder, or its ``test/``, states; raises as `read_capture`."""
    found = read_cameras(root, find_model(root))
    return tuple(sorted(found.shots + found.held_out, key=lambda shot: shot.file))


def _unposed(root: Path, shots: tuple[Shot, ...]) -> list[str]:
    """Tell of photos in images/ that no camera names."""
    folder = root / "images"
    if not shots or not folder.is_dir():
        return []
    known = {shot.image for shot in shots}
    if not any(path.is_relative_to(folder) for path in known):
        return []  # the cameras are those of photos elsewhere, such as images_4/
    found = [path for path in folder.rglob("*") if path.suffix.lower() in PHOTO_SUFFIXES and path.is_file()]
    photos = [path for path in found if not path.name.startswith(".") and not path.name.endswith(".mask.png")]
    left = sorted(path for path in without_raw_twins(photos) if path not in known)
    if not left:
        return []
    name = left[0].relative_to(folder).as_posix()
    return [
        f"{len(left)} of {len(photos)} photos in {folder} have no camera and are left out, the first is {name}: "
        "calibrate them (ibrpipe run photos), or take them out"
    ]


def _models(root: Path, cameras: Path | None) -> tuple[Path | None, Path | None]:
    """COLMAP models of the photos and of ``test/``: those of `cameras` where it has them, else the capture's own."""
    own = find_model(root), find_model(root / "test")
    if cameras is None:
        return own
    return find_model(cameras) or own[0], find_model(cameras / "test") or own[1]


def _headers(shots: tuple[Shot, ...]) -> list[ImageHeader]:
    """Headers of all photos; raises once for all that are missing or unreadable."""
    for file, poses in Counter(shot.file for shot in shots).most_common(1):
        if poses > 1:
            raise CaptureError(f"{shots[0].image.parent}: photo {file} has {poses} poses; keep one")
    missing = [shot for shot in shots if not shot.image.is_file()]
    if missing:
        raise MissingFileError(
            f"{missing[0].image}: the photo does not exist ({len(missing)} of {len(shots)} photos that the cameras "
            "name are missing); put them there or remove them from the model"
        )
    return [read_header(shot.image) for shot in shots]


def _views(
    root: Path,
    shots: tuple[Shot, ...],
    headers: list[ImageHeader],
    gains: list[float],
    options: CaptureOptions,
    told: _Told,
) -> tuple[View, ...]:
    names = _names([shot.file for shot in shots])
    problems: list[IbrError] = []
    views: list[View] = []
    photos = [MaskedPhoto(shot.file, shot.image, shot.mask, header.has_alpha) for shot, header in zip(shots, headers)]
    masks, notes, warnings = find_masks(root, photos)
    told.notes.extend(notes)
    told.warnings.extend(warnings)
    for shot, header, name, gain, mask in zip(shots, headers, names, gains, masks):
        try:
            views.append(_view(root, shot, header, name, gain, mask, options))
        except (CaptureError, FormatError, MissingFileError) as error:
            problems.append(error)
    if problems:
        more = f" ({len(problems) - 1} more photos have such problems)" if len(problems) > 1 else ""
        raise type(problems[0])(f"{problems[0]}{more}")
    turned = sum(view.oriented for view in views)
    if turned:
        told.notes.append(
            f"{turned} photos of {root.name} are turned as their orientation tag says, to fit their cameras"
        )
    return tuple(views)


def _view(
    root: Path, shot: Shot, header: ImageHeader, name: str, gain: float, mask: MaskChoice, options: CaptureOptions
) -> View:
    oriented = _oriented(shot, header, options.orientation)
    K, width, height = undistorted_calibration(shot.lens, options.keep)
    try:
        camera = Camera(K, shot.cam_from_world, width, height)
    except ValueRangeError as error:
        raise CaptureError(f"{shot.image}: {error}") from error
    if mask.file is not None:
        _check_mask(mask.file, shot, oriented)
    return View(
        name=name,
        camera=camera,
        image=shot.image,
        mask=mask.file,
        mask_from_alpha=mask.from_alpha,
        mask_rule=mask.rule,
        gain=gain,
        color_space=options.color_space,
        distortion=shot.lens if shot.lens.distorted else None,
        oriented=oriented,
        depth=_depth(root, shot.file),
    )


def _oriented(shot: Shot, header: ImageHeader, orientation: Orientation) -> bool:
    """Decide whether the orientation tag is obeyed, and check the size against the camera's."""
    wanted = (shot.lens.width, shot.lens.height)
    as_stored, upright = (header.width, header.height), header.upright_size
    if orientation != "apply" and as_stored == wanted:
        return False
    if orientation != "ignore" and upright == wanted:
        return header.orientation != 1
    raise CaptureError(
        f"{shot.image}: is {as_stored[0]} x {as_stored[1]} pixels but its camera states {wanted[0]} x {wanted[1]}; "
        "use the photos that were calibrated, or scale the cameras"
    )


def _check_mask(mask: Path, shot: Shot, oriented: bool) -> None:
    header = read_header(mask)
    size = header.upright_size if oriented else (header.width, header.height)
    if size != (shot.lens.width, shot.lens.height):
        raise CaptureError(
            f"{mask}: is {size[0]} x {size[1]} pixels but photo {shot.file} is {shot.lens.width} x {shot.lens.height}; "
            "a mask has its photo's size"
        )


def _depth(root: Path, file: str) -> Path | None:
    stem = Path(file).with_suffix("").as_posix()
    for suffix in (".exr", ".npy", ".png"):
        candidate = root / "depth" / f"{stem}{suffix}"
        if candidate.is_file():
            return candidate
    return None


def _names(files: list[str]) -> list[str]:
    """File-name-safe names, unique: the stem, with its suffix where two photos share a stem."""
    stems = [Path(file).with_suffix("").as_posix().replace("/", "__") for file in files]
    shared = {stem for stem, count in Counter(stems).items() if count > 1}
    whole = [file.replace("/", "__").replace(".", "_") for file in files]
    return [name if stem in shared else stem for stem, name in zip(stems, whole)]


def _gains(
    root: Path, shots: tuple[Shot, ...], headers: list[ImageHeader], exposure: Exposure, told: _Told
) -> tuple[list[float], str]:
    table = root / EXPOSURES
    if exposure == "csv" and not table.is_file():
        raise MissingFileError(f"{table}: does not exist although exposure is 'csv'; add it or set exposure: none")
    if exposure == "csv" or (exposure == "auto" and table.is_file()):
        return gains_from_csv(read_exposure_csv(table), [shot.file for shot in shots], table), "csv"
    if exposure in ("exif", "auto"):
        gains = gains_from_exif(headers)
        if gains is not None:
            return gains, "exif"
        gains, text = gains_from_partial_exif(headers, [shot.file for shot in shots])
        if text:
            told.warnings.append(text)
        if gains is not None:
            return gains, "exif"
        if exposure == "exif":
            raise CaptureError(
                f"{root}: not every photo has exposure time, f-number and ISO; set exposure: none or csv"
            )
    return [1.0] * len(shots), "none"


def _split(views: tuple[View, ...], every: int, notes: list[str]) -> tuple[tuple[View, ...], tuple[View, ...]]:
    """Hold out every n-th photo, unless fewer than n + 1 photos exist."""
    if every < 1 or len(views) <= every:
        notes.append(f"no test/ folder and {len(views)} photos: none is held out, so nothing measures new views")
        return views, ()
    notes.append(f"no test/ folder: every {every}th photo is held out for measuring")
    train = tuple(view for index, view in enumerate(views) if index % every)
    return train, tuple(replace(view, held_out=True) for view in views[::every])


def _mesh_files(root: Path) -> list[Path]:
    """Meshes by the names that we, and a COLMAP dense workspace, have for them, best first."""
    names = [f"mesh{suffix}" for suffix in SUFFIXES] + ["meshed-poisson.ply", "meshed-delaunay.ply"]
    return [root / name for name in names if (root / name).is_file()]


def _mesh(root: Path, named: Path | None, told: _Told, outside: bool) -> Path | None:
    found = _mesh_files(root)
    if not outside:
        _check_inside(root, [*found, *([] if found or named is None else [named])])
    if len(found) > 1:
        told.notes.append(f"several meshes: {found[0].name} is used, {', '.join(path.name for path in found[1:])} not")
    if found:
        return found[0]
    if named is None:
        return None
    if not named.is_file():
        told.notes.append(f"{named.name}, which transforms.json names as ply_file_path, does not exist")
        return None
    if not has_faces(named):
        text = f"{named.name}, which transforms.json names, is a point cloud and no mesh"
        told.notes.append(f"{text}: `ibrpipe run calibrated` makes one from the photos")
        return None
    told.notes.append(f"the mesh is {named.name}, which transforms.json names")
    return named
