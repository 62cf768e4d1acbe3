"""What is wrong, doubtful or noteworthy in a capture, found before anything expensive runs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import product
from pathlib import Path

import numpy as np

from ibrpipe.capture import audit_words
from ibrpipe.capture.coverage import SurfacePoints, agreement, seen_points, spread_points
from ibrpipe.capture.findings import Limits, by_harm
from ibrpipe.capture.mask_sense import inverted_masks, keeps_rim, perhaps_inverted
from ibrpipe.capture.photo_quality import damaged, empty_mask, measure_photo, photo_findings
from ibrpipe.capture.units import median_or_nan, other_units
from ibrpipe.embree import MeshCaster
from ibrpipe.errors import CaptureError, IbrError
from ibrpipe.io.captures import Capture
from ibrpipe.io.documents.audit import Audit, AuditedPhoto, AuditedSurface, Finding
from ibrpipe.io.views import View, hold_out_advice, load_depth, load_view
from ibrpipe.progress import track
from ibrpipe.types import Array, Mesh


def audit_capture(capture: Capture, mesh: Mesh | None, limits: Limits | None = None) -> Audit:
    """Look at every photo once and, where there is a mesh, at its surface through all of them.

    Parameters
    ----------
    capture : Capture
    mesh : Mesh or None
        None: nothing is said of how well the surface is seen.
    limits : Limits, optional

    Returns
    -------
    Audit
    """
    limits = limits or Limits()
    findings = _told_findings(capture) + _count_findings(capture) + _pose_findings(capture.train, capture.test)
    surface = None if mesh is None else Surface(spread_points(mesh, limits.samples), MeshCaster(mesh))
    photos: list[AuditedPhoto] = []
    rims: list[bool] = []
    for view in track(capture.train + capture.test, "audit"):
        try:
            figures = _look(view, surface, rims)
        except (IbrError, MemoryError) as error:
            findings.append(damaged(view, error))
            continue
        if figures.covered == 0:
            findings.append(empty_mask(view))
        photos.append(figures)
    findings += photo_findings(photos, limits)
    coverage = None if surface is None else surface.coverage()
    if surface is not None and coverage is not None:
        findings += _surface_findings(photos, surface, capture, limits)
    elif mesh is None:
        findings += perhaps_inverted(capture.root, rims)
    return Audit(findings=by_harm(findings), photos=photos, surface=coverage)


def stop_on_errors(audit: Audit) -> None:
    """Raise the first error in one line, with the number of further ones.

    Raises
    ------
    CaptureError
    """
    if audit.errors:
        others = len(audit.errors) - 1
        more = f" (and {others} further error{'s' if others > 1 else ''})" if others else ""
        raise CaptureError(f"{audit.errors[0].line}{more}")


def terminal_summary(audit: Audit, capture: Capture) -> str:
    """Return what a user should see at once of an audit."""
    return audit_words.terminal_summary(audit.findings, str(capture.root), len(capture.train), len(capture.test))


def write_audit(audit: Audit, capture: Capture, data: Path, text: Path) -> None:
    """Write the audit as JSON to `data`, and as words to `text`."""
    data.write_text(audit.to_json() + "\n", encoding="utf-8")
    counts = f"{len(capture.train)} photos, {len(capture.test)} held out; exposure: {capture.exposure}"
    head = [f"{capture.root.name}: {counts}"]
    text.write_text(audit_words.whole_text(audit.findings, head, audit.surface), encoding="utf-8")


class Surface:
    """A mesh, and what has been learnt of it from the photos looked at so far."""

    def __init__(self, points: SurfacePoints, caster: MeshCaster) -> None:
        self._points, self._caster = points, caster
        self._observers = np.zeros(len(points.position), np.int32)
        self.backs: list[float] = []
        self.overlaps: list[tuple[float, float]] = []

    @property
    def diagonal(self) -> float:
        """Of the mesh's bounding box, scene units."""
        return self._points.diagonal

    def around(self, places: Array) -> float:
        """Return the median over places (N, 3) of the share of 26 directions that meet the mesh; 1 = inside it."""
        directions = np.array([each for each in product((-1.0, 0.0, 1.0), repeat=3) if any(each)])
        origins = np.repeat(places, len(directions), axis=0)
        hits = self._caster.cast(origins, np.tile(directions, (len(places), 1)))
        return float(np.median((hits.face >= 0).reshape(len(places), -1).mean(axis=1)))

    def look(self, view: View, mask: Array) -> tuple[float, float | None]:
        """Take note of what a photo sees; return the share of the area, and how far mask and outline agree."""
        seen = seen_points(self._points, view.camera, mask, self._caster)
        overlap, backs, inverse = agreement(view.camera, mask, self._caster)
        self.backs.append(backs)
        if view.masked and math.isfinite(overlap) and math.isfinite(inverse):
            self.overlaps.append((overlap, inverse))
        self._observers += seen * (not view.held_out)
        return float(seen.mean()), overlap if view.masked and math.isfinite(overlap) else None

    def coverage(self) -> AuditedSurface:
        """Return the shares of the area by how many photos see it."""
        return _surface(self._observers, self._points)


def _look(view: View, surface: Surface | None, rims: list[bool]) -> AuditedPhoto:
    colour, mask = load_view(view)
    if view.masked:
        rims.append(keeps_rim(mask))
    if view.depth is not None:
        load_depth(view)
    sharpness, clipped, black, covered = measure_photo(view, colour, mask)
    seen, overlap = (None, None) if surface is None else surface.look(view, mask)
    return AuditedPhoto(
        name=view.name,
        held_out=view.held_out,
        sharpness=sharpness,
        clipped=clipped,
        black=black,
        covered=covered,
        seen=seen,
        overlap=overlap,
        masked=view.masked,
    )


def _told_findings(capture: Capture) -> list[Finding]:
    """What reading has left out or decided."""
    name = capture.root.name
    left = [Finding("warning", "left out", name, text, "all of it", "see the text") for text in capture.warnings]
    return left + [Finding("note", "decided", name, text, "this", "nothing to do") for text in capture.notes]


def _count_findings(capture: Capture) -> list[Finding]:
    findings = []
    count, root = len(capture.train), str(capture.root)
    if count < 2:
        remedy = "add photos, or hold out fewer (ingest.hold_out_every)" if capture.test else "add photos"
        findings.append(
            Finding("error", "too few", root, f"holds {count} photo(s) to build from", "at least 2", remedy)
        )
    elif count < 10:
        text = f"holds {count} photos to build from"
        findings.append(Finding("warning", "few", root, text, "30 or more for shiny things", "add photos all around"))
    if not capture.test:
        text = "has no photo held out"
        findings.append(
            Finding("warning", "no test", root, text, "a test/ folder or more photos", _without_test(count))
        )
    unmasked = [view.name for view in capture.train if not view.masked]
    if unmasked and len(unmasked) < count:
        text = f"{len(unmasked)} of {count} photos have no mask"
        findings.append(
            Finding("warning", "no mask", unmasked[0], text, "a mask for all or none", "add the missing ones")
        )
    return findings


def _without_test(count: int) -> str:
    """Say what a run without held-out photos lacks, and how some can be held out."""
    less = f", unless --set ingest.hold_out_every={hold_out_advice(count)}" if hold_out_advice(count) else ""
    return f"new views will not be measured{less}"


def _pose_findings(train: Sequence[View], test: Sequence[View]) -> list[Finding]:
    """Photos from the same place in the same direction: doubled files, or a test view that is no test."""
    views = [*train, *test]
    if len(views) < 2:
        return []
    poses = np.array([view.camera.cam_from_world.ravel() for view in views])
    scale = max(float(np.ptp([view.camera.center for view in views], axis=0).max()), 1e-12)
    poses[:, 3::4] /= scale
    findings = []
    for index in range(1, len(views)):
        same = np.flatnonzero(np.abs(poses[:index] - poses[index]).max(axis=1) < 1e-9)
        if len(same):
            one, two = views[same[0]], views[index]
            across = one.held_out != two.held_out
            expected = "test views that no training photo repeats" if across else "every photo from its own place"
            remedy = "take it out of one of them: scores are flattered" if across else "remove one"
            text = f"has the same pose as {one.name}"
            findings.append(Finding("warning", "same pose", two.name, text, expected, remedy))
    return findings


def _surface(observers: Array, points: SurfacePoints) -> AuditedSurface:
    """Shares of the area by how many photos see it, and where those lie that fewer than three see."""
    thin = observers < 3
    center = points.position[thin].mean(axis=0) if thin.any() else np.full(3, np.nan)
    facing = points.normal[thin].mean(axis=0) if thin.any() else np.full(3, np.nan)
    counts = np.bincount(np.minimum(observers, 10), minlength=11) / len(observers)
    return AuditedSurface(
        unseen=min(float(counts[0]), 1.0),
        fewer_than_3=min(float(counts[:3].sum()), 1.0),
        median_photos=int(np.median(observers)),
        share_by_photos={f"{n}{'+' if n == 10 else ''}": float(share) for n, share in enumerate(counts)},
        thin_center=center.tolist() if thin.any() else None,
        thin_facing=facing.tolist() if thin.any() else None,
        samples=len(observers),
    )


def _surface_findings(
    photos: Sequence[AuditedPhoto], surface: Surface, capture: Capture, limits: Limits
) -> list[Finding]:
    file, coverage = str(capture.mesh), surface.coverage()
    backs = median_or_nan(surface.backs)
    seen = any(photo.seen for photo in photos if not photo.held_out)
    centers = np.array([view.camera.center for view in capture.train])
    overlap = float(np.median(surface.overlaps, axis=0)[0]) if surface.overlaps else None
    units = other_units(file, surface.diagonal, centers, (backs, surface.around(centers)), overlap, seen or not photos)
    if units is not None and units.severity == "error":
        return [units]
    inverted = inverted_masks(capture.root, surface.overlaps)
    if inverted:
        return inverted
    if photos and not seen:
        expected = "mesh and cameras in one world, in the same units"
        return [Finding("error", "unseen mesh", file, "no photo sees any of the mesh", expected, "align them")]
    wound = []
    if backs > 0.5:
        text, expected = f"photos see the backs of its faces ({backs:.0%} of the pixels)", "counter-clockwise ones"
        wound = [Finding("note", "inside out", file, text, expected, "nothing to do, the plan turns them")]
    return [*([units] if units else []), *wound, *_thin_findings(file, coverage, limits)]


def _thin_findings(file: str, surface: AuditedSurface, limits: Limits) -> list[Finding]:
    if surface.thin_center is not None and surface.fewer_than_3 > limits.thin:
        text = f"fewer than 3 photos see {surface.fewer_than_3:.1%} of its area ({surface.unseen:.1%}: none)"
        x, y, z = surface.thin_center
        text += f", around ({x:.3g}, {y:.3g}, {z:.3g})"
        expected = f"at most {limits.thin:.0%}"
        return [Finding("warning", "thin coverage", file, text, expected, "add photos of the rest, or crop the mesh")]
    return []
