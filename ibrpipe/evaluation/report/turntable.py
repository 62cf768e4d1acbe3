"""The object in the report, from all sides: a page in a frame that runs its own script and nothing else."""

from __future__ import annotations

import base64
import hashlib
from dataclasses import dataclass


@dataclass(frozen=True)
class Turntable:
    """What there is to turn.

    Attributes
    ----------
    page : str
        A whole HTML page; empty = none.
    script : str
        Its script, as a Content-Security-Policy names it.
    told : str
        Why there is no page.
    """

    page: str = ""
    script: str = ""
    told: str = ""


def policy(script: str, turntable: Turntable | None) -> str:
    """Return the report's Content-Security-Policy: its own script and the turntable's, pictures inside the file.

    A page in a frame that is part of the file obeys the policies of both.
    """
    own = "sha256-" + base64.b64encode(hashlib.sha256(script.encode("utf-8")).digest()).decode("ascii")
    scripts = [own] + ([turntable.script] if turntable is not None and turntable.script else [])
    allowed = " ".join(f"'{each}'" for each in scripts)
    return (
        f"default-src 'none'; script-src {allowed}; style-src 'unsafe-inline'; img-src data:; base-uri 'none'; "
        "form-action 'none'"
    )
