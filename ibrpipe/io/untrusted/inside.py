"""Names that a file states, as paths inside a folder: nothing leads out of it, links included."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path, PureWindowsPath

from ibrpipe.errors import FormatError

#: bytes that a file system takes as one name, and letters of a whole path that a file may state
_LONGEST_NAME, _LONGEST_PATH = 255, 1000


def inside(root: Path, name: str, source: Path, remedy: str) -> Path:
    """Return ``root / name``, which exists inside `root`, or would.

    Parameters
    ----------
    root : Path
        Folder.
    name : str
        What `source` states: relative, with ``/`` or ``\\``.
    source : Path
        File that states it, for messages.
    remedy : str
        End of the message.

    Raises
    ------
    FormatError
        The name is absolute, climbs out by ``..`` or by a link, or is none that a file can have.
    """
    parts = PureWindowsPath(name[: _LONGEST_PATH + 1])
    if (
        not 0 < len(name) <= _LONGEST_PATH
        or "\0" in name
        or any(len(part.encode("utf-8", "replace")) > _LONGEST_NAME for part in parts.parts)
    ):
        raise FormatError(f"{source}: {shortened(name)!r} is no name of a file; {remedy}")
    if parts.drive or parts.root or _climbs_out(parts.parts) or not leads_inside(root, root / name):
        raise FormatError(f"{source}: {shortened(name)!r} leads out of {root}; {remedy}")
    return root / name


def _climbs_out(parts: Sequence[str]) -> bool:
    """Say whether ``..`` leads above where the parts of a name begin, on a system that parts names so."""
    depth = 0
    for part in parts:
        depth += -1 if part == ".." else 1
        if depth < 0:
            return True
    return False


def leads_inside(root: Path, path: Path) -> bool:
    """Say whether a path, with every link followed, is below the folder `root`."""
    try:
        return path.resolve().is_relative_to(root.resolve())
    except (OSError, RuntimeError, ValueError):  # a loop of links, or no name that a file can have
        return False


def is_file_name(name: str) -> bool:
    """Say whether a text can be the name of one file, suffix to come, on every system."""
    return (
        name not in ("", ".", "..")
        and len(name.encode("utf-8", "replace")) <= _LONGEST_NAME - 20
        and not any(sign in '/\\:*?"<>|' or sign < " " for sign in name)
    )


def shortened(text: str) -> str:
    """Return a text that may be of any length as a message can show it."""
    return text if len(text) <= 80 else f"{text[:77]}..."
