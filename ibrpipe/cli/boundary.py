"""The one place where errors become one line on stderr and an exit code."""

from __future__ import annotations

import errno
from collections.abc import Iterator
from contextlib import contextmanager
from typing import IO, Any

import click

from ibrpipe.errors import IbrError
from ibrpipe.io.untrusted.inside import shortened


class Failure(click.ClickException):
    """A failure told in one line; exit code 1."""

    exit_code = 1

    def show(self, file: IO[Any] | None = None) -> None:
        """Print the line."""
        click.echo(f"error: {' '.join(self.message.split())}", file=file, err=file is None)


class Interrupted(click.ClickException):
    """Ctrl-C; exit code 130, as shells have it."""

    exit_code = 130

    def show(self, file: IO[Any] | None = None) -> None:
        """Print the line."""
        click.echo(self.message, file=file, err=file is None)


@contextmanager
def one_line() -> Iterator[None]:
    """Turn what a user can mend into `Failure`, Ctrl-C into `Interrupted`; programming errors pass unchanged."""
    try:
        yield
    except KeyboardInterrupt as error:
        raise Interrupted("interrupted; finished stages are kept, run the same command again to go on") from error
    except MemoryError as error:
        raise Failure(f"not enough memory ({error or 'no figure given'}); use smaller photos or settings") from error
    except IbrError as error:
        raise Failure(str(error)) from error
    except UnicodeEncodeError as error:
        if "surrogates" not in error.reason:
            raise
        name = str(error.object).encode("utf-8", "backslashreplace").decode("utf-8")
        raise Failure(f"a file or folder has a name that is not UTF-8 ({name[:200]}); rename it") from error
    except OSError as error:
        told = _told(error)
        if told is None:
            raise
        raise Failure(told) from error


def _told(error: OSError) -> str | None:
    """Return the line for what the machine refuses, None for any other error."""
    path = error.filename2 or error.filename  # of a copy, where it goes to
    where = f" at {path}" if path else ""
    short = error.errno is None and "requested and" in str(error)  # NumPy's words for a file cut short, without a cause
    if short or error.errno in (errno.ENOSPC, errno.EDQUOT):
        return f"no space left on the disk{where}; make room and run the same command again"
    if error.errno in (errno.EACCES, errno.EPERM, errno.EROFS):
        return f"no permission to use the file or folder{where} ({error.strerror}); choose another or change its rights"
    if error.errno in (errno.ENOTDIR, errno.EEXIST, errno.EISDIR, errno.ELOOP, errno.ENAMETOOLONG):
        return f"{shortened(str(path))}: cannot be used ({str(error.strerror).lower()}); give another folder or file"
    return None
