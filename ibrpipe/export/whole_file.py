"""Files that appear whole or not at all."""

from __future__ import annotations

import os
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

from ibrpipe.errors import ConfigError, ResourceError


def write_files(folder: Path, files: Mapping[str, bytes]) -> None:
    """Write files by name into `folder`, which is made where it is missing; all are complete before one gets its name.

    Raises
    ------
    ResourceError
        One cannot be written.
    """
    drafts = {name: folder / f".{name}.partial" for name in files}
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, content in files.items():
            drafts[name].write_bytes(content)
        for name, draft in drafts.items():
            draft.replace(folder / name)
    except OSError as error:
        raise ResourceError(f"{folder}: cannot write {', '.join(files)}: {error.strerror or error}") from error
    finally:
        for draft in drafts.values():
            with suppress(OSError):
                draft.unlink(missing_ok=True)


def megabytes(count: int) -> str:
    """Return bytes as text."""
    return f"{count / 1e6:.2f} MB"


def check_file(target: Path) -> None:
    """Refuse a target that no file can become, before any work is done.

    Raises
    ------
    ConfigError
        It is a folder.
    ResourceError
        Nothing can be written where it is to lie.
    """
    if target.is_dir():
        raise ConfigError(f"{target}: is a folder; name a file, such as {target / 'NAME'}{target.suffix}")
    _check_place(target)


def check_folder(target: Path, mark: str, what: str) -> None:
    """Refuse a target that is no folder to write, before any work is done.

    Parameters
    ----------
    mark : str
        A file by which an earlier export is known, which is replaced.
    what : str
        What that is called.

    Raises
    ------
    ConfigError
        It is a file, or a folder with something else in it.
    ResourceError
        Nothing can be written where it is to lie.
    """
    if target.is_file():
        raise ConfigError(f"{target}: is a file; name a folder")
    if target.is_dir() and any(target.iterdir()) and not (target / mark).is_file():
        raise ConfigError(f"{target}: holds something that is no {what}; name another folder")
    _check_place(target)


def _check_place(target: Path) -> None:
    nearest = next(each for each in (target.absolute(), *target.absolute().parents) if each.exists())
    nearest = nearest if nearest.is_dir() or nearest != target.absolute() else nearest.parent
    if not nearest.is_dir():
        raise ResourceError(f"{target}: cannot write: {nearest} is a file, not a folder; name another place")
    if not os.access(nearest, os.W_OK):
        raise ResourceError(f"{target}: cannot write: no permission to write in {nearest}; name another place")
