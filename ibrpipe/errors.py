"""Errors that ibrpipe raises on purpose.

Every message says what is wrong, the value met, what was expected and the remedy. The command line turns an
`IbrError` into one line and exit code 1.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class IbrError(Exception):
    """Root of all errors raised by ibrpipe on purpose."""


class ShapeError(IbrError, ValueError):
    """An array has the wrong shape or dtype."""


class ValueRangeError(IbrError, ValueError):
    """A number is NaN, infinite or out of its range."""


class CaptureError(IbrError, ValueError):
    """A capture folder cannot be used as it is."""


class FormatError(IbrError, ValueError):
    """A file exists but does not hold what its name promises."""


class MissingFileError(IbrError, FileNotFoundError):
    """A file that is needed does not exist."""


class ConfigError(IbrError, ValueError):
    """A pipeline file or a setting is wrong."""


class RendererError(IbrError, ValueError):
    """A renderer cannot render this source, or does not know this option."""


class ResourceError(IbrError, OSError):
    """The disk, the memory or a system library does not suffice."""


def closest(name: object, valid: Iterable[object]) -> str:
    """Say which of the `valid` names is probably meant, or list them."""
    names = [str(each) for each in valid]
    found = difflib.get_close_matches(str(name), names, n=1)
    if found:
        return f'did you mean "{found[0]}"?'
    return f"expected one of: {', '.join(names)}" if names else "nothing may stand here"
