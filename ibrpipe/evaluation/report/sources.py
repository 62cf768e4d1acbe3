"""What the report tells besides the scores: the capture, the plan's reasons, the audit's findings."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ibrpipe.capture.audit_words import below, worst_warnings
from ibrpipe.capture.findings import Finding
from ibrpipe.io.manifest import read_manifest
from ibrpipe.io.views import ViewSet

#: warnings in the head of the page
WARNINGS = 4


@dataclass(frozen=True)
class ReportSources:
    """Facts of the run.

    Attributes
    ----------
    name : str
        Name of the capture folder.
    train, test : int
        Number of photos used and held out.
    size : (int, int)
        Width and height of the first photo in pixels.
    reasons : tuple of mapping
        The plan's ``{what, choice, reason, measured}``.
    findings : tuple of Finding
        The audit's, files named from the capture folder on.
    surface : mapping
        The audit's figures of how well the surface is seen.
    geometry : mapping
        What ``geometry.json`` says of the surface, and the memory it took; None where it was given.
    """

    name: str
    train: int
    test: int
    size: tuple[int, int]
    reasons: tuple[dict[str, Any], ...] = ()
    findings: tuple[Finding, ...] = ()
    surface: dict[str, Any] | None = None
    geometry: dict[str, Any] | None = None

    @property
    def warnings(self) -> list[str]:
        """The worst of the audit's warnings, one of every kind, and how many more there are."""
        shown, more = worst_warnings(self.findings, WARNINGS)
        return [*shown, f"{more} more below"] if more else shown

    @property
    def rungs(self) -> list[dict[str, Any]]:
        """The reasons that tell what was modelled, from less to more data."""
        return [entry for entry in self.reasons if str(entry.get("what", "")).startswith("rung ")]


def read_sources(views: ViewSet, plan: Path | None, audit: Path | None, geometry: Path | None) -> ReportSources:
    """Gather what is known from the documents of earlier stages; None leaves one out."""
    capture = str(views.info.get("capture", ""))
    planned, audited, made = _read(plan), _read(audit), _read(geometry)
    manifest = None if geometry is None else read_manifest(geometry.parent)
    cost = None if manifest is None else manifest.peak_memory_bytes
    first = (views.train + views.test)[0].camera
    return ReportSources(
        name=Path(capture).name or "capture",
        train=len(views.train),
        test=len(views.test),
        size=(first.width, first.height),
        reasons=tuple(planned.get("reasons", ())),
        findings=tuple(below(Finding(**finding), capture) for finding in audited.get("findings", ())),
        surface=audited.get("surface") or made.get("coverage") or None,
        geometry=None if made.get("decision", "given") == "given" else {**made, "peak_memory_bytes": cost},
    )


def _read(path: Path | None) -> dict[str, Any]:
    if path is None or not path.is_file():
        return {}
    content = json.loads(path.read_text(encoding="utf-8"))
    return content if isinstance(content, dict) else {}
