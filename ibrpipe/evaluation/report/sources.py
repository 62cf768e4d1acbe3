"""What the report tells besides the scores: the capture, the plan's reasons, the audit's findings."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TypeGuard

from ibrpipe.capture.audit_words import below, worst_warnings
from ibrpipe.io.documents.audit import Audit, AuditedSurface, Finding
from ibrpipe.io.documents.geometry import Geometry
from ibrpipe.io.documents.plan import Plan, Reason
from ibrpipe.io.manifest import read_manifest
from ibrpipe.io.views import ViewSet

#: warnings in the head of the page
WARNINGS = 4
#: names of capture folders that do not tell what is shown
_SAY_NOTHING = ("capture", "captures", "photos", "images", "data")


@dataclass(frozen=True)
class ReportSources:
    """Facts of the run.

    Attributes
    ----------
    name : str
        Of the capture folder, or of the folder around it where it is called no more than "capture".
    train, test : int
        Number of photos used and held out.
    size : (int, int)
        Width and height of the first photo in pixels.
    reasons : tuple of Reason
        The plan's.
    findings : tuple of Finding
        The audit's, files named from the capture folder on.
    surface : AuditedSurface
        How well the surface is seen; None where nobody looked.
    geometry : Geometry
        How the surface was made; None where it was given.
    geometry_memory_bytes : int
        Memory that making it took at most; None where that is not known.
    """

    name: str
    train: int
    test: int
    size: tuple[int, int]
    reasons: tuple[Reason, ...] = ()
    findings: tuple[Finding, ...] = ()
    surface: AuditedSurface | None = None
    geometry: Geometry | None = None
    geometry_memory_bytes: int | None = None

    @property
    def warnings(self) -> list[str]:
        """The worst of the audit's warnings, one of every kind, and how many more there are."""
        shown, more = worst_warnings(self.findings, WARNINGS)
        return [*shown, f"{more} more below"] if more else shown

    @property
    def rungs(self) -> list[Reason]:
        """The reasons that tell what was modelled, from less to more data."""
        return [reason for reason in self.reasons if reason.what.startswith("rung ")]


def read_sources(views: ViewSet, plan: Path | None, audit: Path | None, geometry: Path | None) -> ReportSources:
    """Gather what is known from the documents of earlier stages; None, or no such file, leaves one out.

    Raises
    ------
    FormatError
        A document is damaged.
    """
    capture = str(views.info.get("capture", ""))
    planned = None if not _there(plan) else Plan.read(plan, "not a plan", "plan")
    audited = None if not _there(audit) else Audit.read(audit, "not what the ingest stage writes", "ingest")
    made = None if not _there(geometry) else Geometry.read(geometry, "not what the geometry stage writes", "geometry")
    manifest = None if geometry is None else read_manifest(geometry.parent)
    surface = None if audited is None else audited.surface
    if surface is None and made is not None:
        surface = made.coverage
    first = (views.train + views.test)[0].camera
    return ReportSources(
        name=_title(capture),
        train=len(views.train),
        test=len(views.test),
        size=(first.width, first.height),
        reasons=() if planned is None else tuple(planned.reasons),
        findings=() if audited is None else tuple(below(finding, capture) for finding in audited.findings),
        surface=surface,
        geometry=None if made is None or made.decision == "given" else made,
        geometry_memory_bytes=None if manifest is None else manifest.peak_memory_bytes,
    )


def _title(capture: str) -> str:
    """Return what a capture is called: its folder's name, or that of a folder around it where it says nothing."""
    named = [name for name in reversed(Path(capture).parts) if name.strip("/\\.")]
    return next((name for name in named if name.lower() not in _SAY_NOTHING), named[0] if named else "untitled capture")


def _there(path: Path | None) -> TypeGuard[Path]:
    return path is not None and path.is_file()
