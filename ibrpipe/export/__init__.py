"""Assets and runs in forms that other programs open.

The package can be called: ``ibrpipe.export(asset, path)`` writes an asset. A function of that name could not stand
beside a package of that name, since importing any part of the package would replace it.
"""

from __future__ import annotations

import sys
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ibrpipe.types import Asset


class _CallablePackage(ModuleType):
    """The package as a function."""

    def __call__(
        self, source: Asset | str | Path, target: str | Path, form: str | None = None, **settings: Any
    ) -> str | None:
        """Write an asset, or a folder, in another form; see `ibrpipe.export.api.export`."""
        from ibrpipe.export.api import export

        return export(source, target, form, **settings)


sys.modules[__name__].__class__ = _CallablePackage
