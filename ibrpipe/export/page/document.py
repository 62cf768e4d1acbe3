"""The HTML file: template, style, scripts, and a policy that lets nothing else run or load."""

from __future__ import annotations

import base64
import hashlib
import json
from dataclasses import dataclass
from importlib import resources
from typing import Any

from ibrpipe.export.page.notes import PageNotes
from ibrpipe.version import VERSION

#: in the order in which they are joined
SCRIPTS = (
    "unpack", "surface", "geometry", "matrices", "shaders", "mirror", "reflection", "spiral", "kept", "scene",
    "programs", "stage", "renderer", "orbit", "flight", "input", "notes", "photos", "compare", "main",
)  # fmt: skip


@dataclass(frozen=True)
class Page:
    """A page's HTML, and what there is to tell of it."""

    text: str
    told: str = ""


def page_text(notes: PageNotes, meta: dict[str, Any], data: str, poster: bytes) -> str:
    """Return the page.

    Parameters
    ----------
    meta : dict
        What the scripts read as JSON.
    data : str
        Base64 of the packed arrays.
    poster : bytes
        WebP picture for browsers that cannot draw the object.
    """
    from jinja2 import Environment, StrictUndefined
    from markupsafe import Markup

    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    style, script = _file("page.css"), script_text()
    return environment.from_string(_file("page.html")).render(
        generator=f"ibrpipe {VERSION}",
        policy=policy(style, script),
        notes=notes,
        style=Markup(style),
        script=Markup(script),
        meta=Markup(json_in_html(meta)),
        data=Markup(data),
        poster=base64.b64encode(poster).decode("ascii"),
    )


def script_text() -> str:
    """Return all scripts as one that shares no name with anything else."""
    parts = "\n".join(_file(f"scripts/{name}.js") for name in SCRIPTS)
    return f'"use strict";\n(() => {{\n{parts}}})();\n'


def policy(style: str, script: str) -> str:
    """Return the Content-Security-Policy: this script, this style, pictures inside the file, and nothing else."""
    return (
        f"default-src 'none'; script-src '{source_hash(script)}'; style-src '{source_hash(style)}'; img-src data:; "
        "base-uri 'none'; form-action 'none'"
    )


def json_in_html(content: Any) -> str:
    """Return JSON that no HTML parser takes for markup."""
    text = json.dumps(content, separators=(",", ":"), allow_nan=False)
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def source_hash(text: str) -> str:
    """Return how a Content-Security-Policy names a script or a style that is part of the page."""
    return "sha256-" + base64.b64encode(hashlib.sha256(text.encode("utf-8")).digest()).decode("ascii")


def _file(name: str) -> str:
    return resources.files("ibrpipe.export.page").joinpath(name).read_text(encoding="utf-8")
