"""Thin, checked wrappers around the kernels of :mod:`ibrpipe.core`, found by name in the registry.

The package can be called: ``ibrpipe.renderers()`` lists the renderers. A function of that name could not stand beside a
package of that name, since importing any part of the package would replace it.
"""

from __future__ import annotations

import sys
from types import ModuleType
from typing import Any


class _CallablePackage(ModuleType):
    """The package as a function."""

    def __call__(self) -> dict[str, dict[str, Any]]:
        """Return, by name, what each renderer can render, its paper, its limits and its options."""
        from ibrpipe.renderers.api import renderers

        return renderers()


sys.modules[__name__].__class__ = _CallablePackage
