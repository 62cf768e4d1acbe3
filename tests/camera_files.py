"""What a capture with camera files of other programs comes to."""

from __future__ import annotations

from pathlib import Path

from ibrpipe.io.captures import Capture
from ibrpipe.stages.ingest import IngestConfig, Inputs, run


def told(root: Path, tmp_path: Path) -> str:
    """Return what ingest shows on the terminal."""
    out = tmp_path / "out"
    out.mkdir(exist_ok=True)
    run(Inputs(root, out), IngestConfig())
    return (out / "summary.txt").read_text(encoding="utf-8")


def names(found: Capture) -> list[str]:
    """Return the names of all photos, ascending."""
    return sorted(view.name for view in found.train + found.test)
