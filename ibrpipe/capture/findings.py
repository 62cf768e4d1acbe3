"""One thing that an audit found, and from where on a figure is worth telling."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Severity = Literal["error", "warning", "note"]


@dataclass(frozen=True)
class Finding:
    """One thing that the audit found.

    Attributes
    ----------
    severity : {"error", "warning", "note"}
        Errors stop the pipeline.
    kind : str
        Short fixed word, such as ``blurred``.
    file : str
        What it is about.
    value, expected, remedy : str
        What was met, what would be right, what to do.
    """

    severity: Severity
    kind: str
    file: str
    value: str
    expected: str
    remedy: str

    @property
    def line(self) -> str:
        """The finding as one sentence."""
        return f"{self.file}: {self.value}; expected {self.expected}: {self.remedy}"


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
