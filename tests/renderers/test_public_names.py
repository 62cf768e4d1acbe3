"""Every public name is what it should be, whichever is used first."""

from __future__ import annotations

import subprocess
import sys

import pytest

import ibrpipe


@pytest.mark.parametrize(
    "before", ["", "ibrpipe.render", "import ibrpipe.renderers.ldi", "from ibrpipe.renderers.api import render"]
)
def test_renderers_can_be_called_whatever_was_imported_before(before: str) -> None:
    code = f"import ibrpipe\n{before}\nassert 'ldi' in ibrpipe.renderers()\nimport ibrpipe.renderers.ldi as m"
    code += "\nm.LdiRenderer"
    subprocess.run([sys.executable, "-W", "error", "-c", code], check=True, timeout=120)


@pytest.mark.parametrize("name", ibrpipe.__all__)
def test_every_public_name_exists(name: str) -> None:
    assert getattr(ibrpipe, name) is not None


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = ibrpipe.nothing
