"""The boundary of a reader: what is raised while a file is read leaves it as an `IbrError` that names the file."""

from __future__ import annotations

import os
import stat
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import wraps
from pathlib import Path
from typing import ParamSpec, TypeVar

from ibrpipe.errors import FormatError, IbrError, MissingFileError, ResourceError, ShapeError, ValueRangeError

P = ParamSpec("P")
T = TypeVar("T")
_LONGEST = 200


@contextmanager
def told(path: str | Path, remedy: str, wrong: str = "damaged") -> Iterator[None]:
    """Turn what is raised inside into one line: `path`, what is `wrong` with it, the reason, and the `remedy`.

    Raises
    ------
    MissingFileError
        The file, or one that it needs, does not exist.
    ResourceError
        The memory does not suffice.
    FormatError
        It is a pipe or a device, on which reading would wait; or it is damaged, which makes libraries raise nearly
        everything.
    """
    try:
        if Path(path).exists() and not Path(path).is_dir():
            check_regular(path, Path(path).stat())
        yield
    except IbrError as error:
        if not isinstance(error, ShapeError | ValueRangeError) or str(path) in str(error):
            raise
        raise FormatError(f"{_shown(path)}: {wrong} ({error}); {remedy}") from error
    except FileNotFoundError as error:
        raise MissingFileError(f"{error.filename or path}: does not exist") from error
    except MemoryError as error:
        raise ResourceError(f"{_shown(path)}: needs more memory than there is ({reason(error)})") from error
    except Exception as error:
        raise FormatError(f"{_shown(path)}: {wrong} ({reason(error)}); {remedy}") from error


def reader(remedy: str) -> Callable[[Callable[P, T]], Callable[P, T]]:
    """Wrap a function that reads the file named by its first argument, `path`, into `told`."""

    def wrap(function: Callable[P, T]) -> Callable[P, T]:
        @wraps(function)
        def read(*args: P.args, **kwargs: P.kwargs) -> T:
            with told(str(args[0] if args else kwargs.get("path", "")), remedy):
                return function(*args, **kwargs)

        return read

    return wrap


def utf8_text(path: Path, remedy: str, wrong: str = "not UTF-8 text") -> str:
    """Return the text of a file, without a byte order mark.

    Raises
    ------
    MissingFileError, FormatError
        There is no such file, or it is not UTF-8 text.
    """
    with told(path, f"save it as UTF-8 text, or {remedy}", wrong):
        return path.read_text(encoding="utf-8-sig")


def reason(error: BaseException) -> str:
    """Return what an exception says in one short line."""
    if isinstance(error, RecursionError):
        return "nested too deeply"
    if isinstance(error, OSError) and error.strerror:
        return error.strerror.lower()
    text = " ".join(str(error).split())
    name = type(error).__name__
    told_of = (
        f"{name}: {text}" if isinstance(error, LookupError | AttributeError | AssertionError) or not text else text
    )
    return told_of if len(told_of) <= _LONGEST else told_of[: _LONGEST - 3] + "..."


def check_regular(path: str | Path, status: os.stat_result) -> None:
    """Refuse what would never end: named pipes, devices and sockets.

    Raises
    ------
    FormatError
        `status`, which is that of `path`, is not a file's.
    """
    if not stat.S_ISREG(status.st_mode):
        raise FormatError(f"{path}: is a named pipe, device or socket and no file; take it out of the folder")


def _shown(path: str | Path) -> str:
    text = str(path)
    return text if len(text) <= 2 * _LONGEST else f"{text[:_LONGEST]}...{text[-_LONGEST:]}"
