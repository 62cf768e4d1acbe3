"""A calibrated photo as a camera file states it, before the photo itself is looked at; and where its file is."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from ibrpipe.errors import CaptureError, MissingFileError
from ibrpipe.io.cameras.lenses import Lens
from ibrpipe.io.photos.extra_formats import HEIC_SUFFIXES, RAW_SUFFIXES
from ibrpipe.io.untrusted.inside import leads_inside
from ibrpipe.types import Array

#: Suffixes of photos, as far as names have to be told apart by them
PHOTO_SUFFIXES = (
    *(".jpg", ".jpeg", ".png", ".tif", ".tiff", ".exr", ".webp", ".bmp", ".jp2"),
    *HEIC_SUFFIXES,
    *RAW_SUFFIXES,
)


@dataclass(frozen=True, eq=False)
class Shot:
    """One calibrated photo before its file is looked at.

    Attributes
    ----------
    file : str
        Name in the model, posix, relative to `image`'s folder of images.
    image : Path
    lens : Lens
    cam_from_world : (3, 4) float64
    mask : Path or None
        Mask that the model itself names.
    """

    file: str
    image: Path
    lens: Lens
    cam_from_world: Array
    mask: Path | None = None


@dataclass(frozen=True, eq=False)
class CameraSet:
    """All that a camera file states.

    Attributes
    ----------
    shots : tuple of Shot
        Sorted by name.
    held_out : tuple of Shot
        Those that the file keeps for measuring.
    mesh : Path or None
        Surface that the file names.
    notes : tuple of str
        What was decided.
    warnings : tuple of str
        What was left out.
    """

    shots: tuple[Shot, ...]
    held_out: tuple[Shot, ...] = ()
    mesh: Path | None = None
    notes: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()


class PhotoFolder:
    """Finds files by the names that other programs, on other machines, have for them."""

    def __init__(self, root: Path, closed: bool = False) -> None:
        """Look in `root`; `closed`: never outside it, whatever a name or a link says."""
        self.root, self._closed = root, closed

    def find(self, label: str, source: Path, near: Iterable[str] = ()) -> Path | None:
        """Return the file that another program calls `label`, or None.

        By its path as `at` has it, then by its file name in any folder, and where the label has no suffix, by its name
        without suffix.

        Parameters
        ----------
        label : str
        source : Path
            File that states the label, for messages.
        near : iterable of str
            Names of folders that tell files of equal names apart.

        Raises
        ------
        CaptureError
            Several files may be meant.
        """
        found = self.at(label, source)
        if found is not None:
            return found
        name = _parts(label)[-1:]
        if not name:
            return None
        named = self._by_name.get(name[0].casefold(), [])
        if not named and not _has_suffix(name[0]):
            named = self._by_stem.get(name[0].casefold(), [])
        return self._one(named, label, source, near) if named else None

    def at(self, label: str, source: Path, suffixes: Iterable[str] = ()) -> Path | None:
        """Return the file at a path, whatever its case, slashes and leading folders; a bare name counts at the top.

        Parameters
        ----------
        label : str
        source : Path
            File that states the label, for messages.
        suffixes : iterable of str
            What may follow where the label has no suffix, best first.

        Raises
        ------
        CaptureError
            Several files differ in nothing but case.
        """
        parts = _parts(label)
        endings = ["", *suffixes] if parts and not _has_suffix(parts[-1]) else [""]
        tails = ["/".join(parts[start:]) for start in range(max(len(parts) - 1, min(len(parts), 1)))]
        whole = [label.strip().replace("\\", "/")] if parts else []
        for name in [*whole, *tails]:
            for ending in endings:
                file = self.root / f"{name}{ending}"
                if file.is_file() and not (self._closed and not leads_inside(self.root, file)):
                    return file
        for name in tails:
            for ending in endings:
                found = self._by_path.get(f"{name}{ending}".casefold(), [])
                if found:
                    return self._one(found, label, source, ())
        return None

    def of_model(self, name: str, source: Path) -> Path | None:
        """Return the photo that a COLMAP model calls `name`: there, or as `at` finds it; None = there is none."""
        if (self.root / name).is_file():
            return self.root / name
        return self.at(name.replace("\\", "/").removeprefix("./").removeprefix("images/"), source)

    def _one(self, found: list[Path], label: str, source: Path, near: Iterable[str]) -> Path:
        """Return the one file that is meant: where there are several, that of a folder called as asked."""
        wanted = {folder.casefold() for folder in near if folder}
        close = [path for path in found if wanted & {part.casefold() for part in path.parent.parts}]
        top = [path for path in found if path.parent == self.root]
        for chosen in (found, close, [] if close else top):
            if len(chosen) == 1:
                return chosen[0]
        names = " or ".join(path.relative_to(self.root).as_posix() for path in found[:3])
        raise CaptureError(
            f"{source}: the photo {label} may be {names}; expected one file of that name: give them different names, "
            "in the folder and in the camera file"
        )

    @cached_property
    def _files(self) -> list[Path]:
        if not self.root.is_dir():
            return []
        found = (path for path in self.root.rglob("*") if path.suffix.lower() in PHOTO_SUFFIXES and path.is_file())
        return sorted(path for path in found if not path.name.endswith(".mask.png"))

    @cached_property
    def _by_path(self) -> dict[str, list[Path]]:
        return _grouped((path.relative_to(self.root).as_posix(), path) for path in self._files)

    @cached_property
    def _by_name(self) -> dict[str, list[Path]]:
        return _grouped((path.name, path) for path in self._files)

    @cached_property
    def _by_stem(self) -> dict[str, list[Path]]:
        return _grouped((path.stem, path) for path in self._files)


def _parts(label: str) -> list[str]:
    return [part for part in label.strip().replace("\\", "/").split("/") if part not in ("", ".", "..")]


def _has_suffix(name: str) -> bool:
    return Path(name).suffix.lower() in PHOTO_SUFFIXES


def _grouped(pairs: Iterable[tuple[str, Path]]) -> dict[str, list[Path]]:
    groups: dict[str, list[Path]] = {}
    for name, path in pairs:
        groups.setdefault(name.casefold(), []).append(path)
    return groups


def photo_root(root: Path) -> Path:
    """Return the folder of a capture, or of its ``test/``, below which its photos have their names.

    ``images/`` where there is one, else the folder itself: a bare folder of photos is a capture, too.
    """
    images = root / "images"
    return images if images.is_dir() else root


def name_below(path: Path, folder: Path) -> str:
    """Return a photo's name relative to a folder, posix; its file name where it lies elsewhere."""
    return path.relative_to(folder).as_posix() if path.is_relative_to(folder) else path.name


def refuse_missing(missing: Sequence[str], total: int, source: Path, folder: Path) -> None:
    """Refuse cameras without photos.

    Parameters
    ----------
    missing : sequence of str
        What `source` calls the photos that were not found.
    total : int
        Photos that it names.
    source, folder : Path
        For the message.

    Raises
    ------
    MissingFileError
        There is any.
    """
    if missing:
        count = f" ({len(missing)} of {total} photos are missing)" if len(missing) > 1 else ""
        raise MissingFileError(f"{source}: names the photo {missing[0]}, which is not in {folder}{count}; put it there")
