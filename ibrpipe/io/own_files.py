"""Folders that are replaced whole, and what users have put into them: it is never deleted.

A folder is ours as far as a document of ours in it (a stage's manifest, the index of an asset) lists its files. When it
is replaced, everything else in it moves along into the new one.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Collection
from pathlib import Path

from ibrpipe.io.manifest import NAME, read_manifest

#: folder -> paths of our own files in it, relative, with ``/``
Listing = Callable[[Path], Collection[str]]


def listed_by_manifest(folder: Path) -> set[str]:
    """Return the files that the manifest in `folder` lists, itself included; none where it cannot be read."""
    manifest = read_manifest(folder)
    return set() if manifest is None else {NAME, *manifest.files}


def put_in_place(new: Path, target: Path, listing: Listing) -> None:
    """Let the folder `new` take the place of `target`; what `listing` does not name in `target` stays in it.

    A file that has the name of a new one gets ``.kept`` behind its own. When the process is killed on the way,
    `recover` does the rest.
    """
    aside = _aside(target)
    if target.exists():
        target.rename(aside)
    new.rename(target)
    _settle(aside, target, listing)


def recover(target: Path, listing: Listing) -> None:
    """Finish what a killed process left of `put_in_place`: nothing but our own old files is lost."""
    aside = _aside(target)
    if aside.is_dir() and not target.exists():
        aside.rename(target)
    _settle(aside, target, listing)


def real_folder(target: Path) -> Path:
    """Return where a link to a folder leads, so that the link itself stays; else `target`."""
    return target.resolve() if target.is_symlink() else target


def _aside(target: Path) -> Path:
    return target.with_name(f".{target.name}.old")


def _settle(aside: Path, target: Path, listing: Listing) -> None:
    """Move what is not ours from `aside` to `target`, and remove the rest of `aside`."""
    if not aside.is_dir():
        return
    own = listing(aside)
    for path in _files(aside):
        name = path.relative_to(aside)
        if name.as_posix() not in own:
            place = target / name
            while os.path.lexists(place):
                place = place.with_name(f"{place.name}.kept")
            place.parent.mkdir(parents=True, exist_ok=True)
            path.rename(place)
    shutil.rmtree(aside, ignore_errors=True)


def _files(folder: Path) -> list[Path]:
    """Return all files below `folder`, and links to folders as they are."""
    found = []
    for root, folders, names in os.walk(folder):
        links = [name for name in folders if (Path(root) / name).is_symlink()]
        found += [Path(root) / name for name in sorted([*names, *links])]
    return found
