"""The audit in words: whole for ``audit.txt``, in a few lines for the terminal and the report's head."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from ibrpipe.capture.findings import TOLD, by_harm
from ibrpipe.io.documents.audit import AuditedSurface, Finding

#: warnings that are shown at once
SHOWN = 6
_MARK = {"error": "ERROR", "warning": "warning", "note": "note"}


def sentence(finding: Finding) -> str:
    """Return the finding in one sentence."""
    return finding.value if finding.kind in TOLD else finding.line


def below(finding: Finding, root: str) -> Finding:
    """Return the finding with files named from the capture folder on, and that folder by its own name."""
    if not root:
        return finding

    def short(text: str) -> str:
        return text.replace(f"{root}/", "").replace(f"{root}\\", "").replace(root, Path(root).name)

    return replace(
        finding,
        file=short(finding.file),
        value=short(finding.value),
        expected=short(finding.expected),
        remedy=short(finding.remedy),
    )


def worst_warnings(findings: Sequence[Finding], lines: int = SHOWN) -> tuple[list[str], int]:
    """Return the worst warnings, one of every kind, and how many more there are.

    What reading has left out is a sentence of its own each time and counts as a kind.
    """
    groups: dict[str, list[Finding]] = {}
    for finding in by_harm(findings):
        if finding.severity == "warning":
            groups.setdefault(finding.value if finding.kind in TOLD else finding.kind, []).append(finding)
    shown = []
    for group in list(groups.values())[:lines]:
        alike = f" (and {len(group) - 1} more like this)" if len(group) > 1 else ""
        shown.append(f"{sentence(group[0])}{alike}")
    return shown, sum(map(len, list(groups.values())[lines:]))


def terminal_summary(findings: Sequence[Finding], root: str, train: int, test: int) -> str:
    """Return what a user should see at once: counts, the worst warnings, what was decided.

    Parameters
    ----------
    findings : sequence of Finding
    root : str
        Capture folder; files in it are named from there.
    train, test : int
        Photos to build from, and held out.
    """
    named = [below(finding, root) for finding in findings]
    warnings, more = worst_warnings(named)
    shown = [f"{train} photos to build from, {test} held out"]
    shown += [f"{_MARK['warning']}: {text}" for text in warnings]
    if more or any("more like this" in text for text in warnings):
        shown.append(f"{more} more warnings in audit.txt" if more else "all of them in audit.txt")
    shown += [f"{_MARK['note']}: {finding.value}" for finding in named if finding.kind == "decided"]
    return "\n".join(shown) + "\n"


def whole_text(findings: Sequence[Finding], head: Sequence[str], surface: AuditedSurface | None) -> str:
    """Return all findings, worst first, below the lines of `head` and the surface's figures."""
    counts = {name: sum(finding.severity == name for finding in findings) for name in _MARK}
    lines = [*head, f"{counts['error']} errors, {counts['warning']} warnings, {counts['note']} notes"]
    if surface:
        lines.append(
            f"surface: {surface.unseen:.1%} of the area seen by no photo, {surface.fewer_than_3:.1%} "
            f"by fewer than 3, {surface.median_photos} photos at the median"
        )
    lines += [f"{_MARK[finding.severity]:8}{sentence(finding)}" for finding in findings]
    return "\n".join(lines) + "\n"
