"""How much harm findings of an audit do, and from where on a figure is worth telling."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from ibrpipe.io.documents.audit import Finding, Severity

_SEVERITIES: tuple[Severity, ...] = ("error", "warning", "note")
#: kinds of findings whose value is the whole sentence
TOLD = ("left out", "decided")
#: kinds of warnings from what spoils everything to what spoils a little; others come behind
_HARM = (
    "inverted masks",
    "units",
    "sees nothing",
    "outline",
    "left out",
    "same pose",
    "no mask",
    "few",
    "thin coverage",
    "no test",
    "black",
    "blurred",
    "clipped",
)


def by_harm(findings: Iterable[Finding]) -> list[Finding]:
    """Return the findings sorted by severity, then by how much harm their kind does; else as they came."""

    def rank(finding: Finding) -> tuple[int, int]:
        harm = _HARM.index(finding.kind) if finding.kind in _HARM else len(_HARM)
        return _SEVERITIES.index(finding.severity), harm

    return sorted(findings, key=rank)


@dataclass(frozen=True)
class Limits:
    """From where on a figure becomes a warning.

    Attributes
    ----------
    blurred : float
        Sharpness below the median by this many robust deviations (of its logarithm), and below half of it.
    clipped, black, thin : float
        Shares of the mask's pixels; share of the surface that fewer than three photos see.
    overlap : float
        Intersection over union of mask and mesh outline.
    samples : int
        Points spread over the surface.
    """

    blurred: float = 3.5
    clipped: float = 0.05
    black: float = 0.5
    thin: float = 0.05
    overlap: float = 0.7
    samples: int = 20000
