"""The page beside impostors that shows them in three.js, and the module that does it."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import resources

from ibrpipe.export.page.document import json_in_html, source_hash
from ibrpipe.version import VERSION

#: where the page finds three.js: beside itself, as ``npm install three`` lays it
IMPORTS = {
    "imports": {
        "three": "./node_modules/three/build/three.module.js",
        "three/addons/": "./node_modules/three/examples/jsm/",
    }
}
SCRIPTS = ("impostors.three.js", "impostors.page.js")


def sample_files(title: str, folders: Mapping[str, str]) -> dict[str, str]:
    """Return the sample page and its scripts, name to text.

    Parameters
    ----------
    title : str
        What is shown.
    folders : mapping of part to folder
    """
    from jinja2 import Environment, StrictUndefined
    from markupsafe import Markup

    style, imports = _file("impostors.css"), json_in_html(IMPORTS)
    page = Environment(autoescape=True, undefined=StrictUndefined).from_string(_file("impostors.html"))
    parts = [{"name": part, "folder": folder} for part, folder in folders.items()]
    text = page.render(
        generator=f"ibrpipe {VERSION}",
        policy=(
            f"default-src 'none'; script-src 'self' '{source_hash(imports)}'; style-src '{source_hash(style)}'; "
            "img-src 'self' blob: data:; connect-src 'self'; base-uri 'none'; form-action 'none'"
        ),
        title=title,
        style=Markup(style),
        imports=Markup(imports),
        parts=Markup(json_in_html(parts)),
    )
    return {"index.html": text, **{name: _file(name) for name in SCRIPTS}}


def _file(name: str) -> str:
    return resources.files("ibrpipe.export").joinpath(f"samples/{name}").read_text(encoding="utf-8")
