"""Folders that appear whole or not at all, and one run at a time in each of them."""

from __future__ import annotations

import errno
import os
import shutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO

from ibrpipe.errors import ResourceError
from ibrpipe.io.own_files import listed_by_manifest, put_in_place, real_folder, recover
from ibrpipe.io.untrusted.boundary import reason
from ibrpipe.io.untrusted.inside import shortened


@contextmanager
def whole_folder(target: Path) -> Iterator[Path]:
    """Yield an empty folder next to `target` that takes its place when the block ends well, and vanishes otherwise.

    What an earlier process left half-done next to `target` is removed first. Files in `target` that its manifest does
    not list stay. Where `target` is a link, the folder that it leads to is replaced.
    """
    with _can_be_made(target):
        target = real_folder(target)
        target.parent.mkdir(parents=True, exist_ok=True)
        remove_stale(target)
        partial = target.with_name(f".{target.name}.partial")
        partial.mkdir()
    try:
        yield partial
        put_in_place(partial, target, listed_by_manifest)
    finally:
        shutil.rmtree(partial, ignore_errors=True)


@contextmanager
def _can_be_made(folder: Path) -> Iterator[None]:
    """Tell in one line that a folder cannot be made; a full disk and missing rights are told elsewhere."""
    try:
        yield
    except (OSError, RuntimeError) as error:  # a loop of links is a RuntimeError
        if isinstance(error, PermissionError) or getattr(error, "errno", None) in (errno.ENOSPC, errno.EDQUOT):
            raise
        raise ResourceError(
            f"{shortened(str(folder))}: cannot be made a folder ({reason(error)}); choose another --out"
        ) from error


def kept_folder(target: Path, key: str) -> Path:
    """Return a hidden folder beside a stage's own, for half-done work that outlives a stop: a later run resumes.

    Parameters
    ----------
    target : Path
        The folder that the stage fills, under its final or its temporary name.
    key : str
        What the work depends on. Work of another key is removed first.
    """
    name = target.name.removeprefix(".").removesuffix(".partial")
    folder = target.with_name(f".{name}.work")
    mark = folder / "key"
    if not mark.is_file() or mark.read_text(encoding="utf-8") != key:
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        mark.write_text(key, encoding="utf-8")
    return folder


def remove_stale(target: Path) -> None:
    """Remove what a killed run left next to `target`, and put an older result back that it had set aside."""
    recover(target, listed_by_manifest)
    shutil.rmtree(target.with_name(f".{target.name}.partial"), ignore_errors=True)


@contextmanager
def only_run(folder: Path) -> Iterator[None]:
    """Hold `folder` for this process; the system lets go of it when the process ends, however it ends.

    Raises
    ------
    ResourceError
        Another process works in it, or it can be no folder.
    """
    with made_folder(folder):
        path = folder / ".lock"
        handle = _held(path)
        while not _is_at(handle, path):  # its last holder removed it between our opening and locking it
            handle.close()
            handle = _held(path)
        try:
            yield
        finally:
            with suppress(PermissionError):  # Windows keeps files that are open
                path.unlink()
            handle.close()


@contextmanager
def made_folder(folder: Path) -> Iterator[None]:
    """Make a folder for the block; where the block fails, folders that were made for it and are empty vanish again.

    Raises
    ------
    ResourceError
        It can be no folder.
    """
    with _can_be_made(folder):
        missing = [each for each in (folder, *folder.parents) if not each.exists()]
        folder.mkdir(parents=True, exist_ok=True)
    try:
        yield
    except BaseException:
        for each in missing:
            with suppress(OSError):
                each.rmdir()
        raise


def _held(path: Path) -> IO[str]:
    handle = path.open("a")
    try:
        _lock(handle)
    except BlockingIOError as error:
        handle.close()
        raise ResourceError(
            f"another ibrpipe works in {path.parent}; wait until it ends or choose another folder with --out"
        ) from error
    return handle


def _is_at(handle: IO[str], path: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(handle.fileno()), path.stat())
    except FileNotFoundError:
        return False


def _lock(handle: IO[str]) -> None:
    if sys.platform == "win32":
        import msvcrt

        try:
            msvcrt.locking(handle.fileno(), msvcrt.LK_NBLCK, 1)
        except PermissionError as error:
            raise BlockingIOError(str(error)) from error
    else:
        import fcntl

        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)


def files_with_sizes(folder: Path) -> dict[str, int]:
    """Return every file below `folder`, relative, to its size in bytes."""
    found = {}
    for root, folders, names in os.walk(folder):
        folders.sort()
        for name in sorted(names):
            path = Path(root) / name
            found[path.relative_to(folder).as_posix()] = path.stat().st_size
    return found
