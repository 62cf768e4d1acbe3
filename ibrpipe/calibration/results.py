"""What came of a calibration, as figures and as words: who is in, how exactly, who is out, and what to shoot."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ibrpipe.calibration.alignment import Aligned
from ibrpipe.calibration.features import Features
from ibrpipe.calibration.job import Job
from ibrpipe.calibration.lenses import Start, angle_of_view
from ibrpipe.calibration.spacing import Shared, shared_of, words
from ibrpipe.engine.provenance import peak_memory
from ibrpipe.io.cameras.colmap_write import ModelImage, SparseModel
from ibrpipe.io.cameras.lenses import Lens, project
from ibrpipe.io.documents.calibration import Calibration
from ibrpipe.types import Array

#: Photos with fewer points than this stand on weak feet
WEAK = 30


def figures(
    job: Job,
    features: Sequence[Features],
    starts: Sequence[Start],
    owner: Sequence[int],
    inliers: Array,
    models: Sequence[SparseModel],
    aligned: Aligned,
    deviations: dict[int, float],
) -> dict[str, Any]:
    """Return the figures of ``calibration.json``.

    Parameters
    ----------
    job : Job
    features : sequence of Features
        Of each photo, as the following.
    starts, owner
        Lenses to begin with, and the lens of each photo.
    inliers : (N, N) int32
        Verified matches between photos.
    models : sequence of SparseModel
        The largest, which is kept, first.
    aligned : Aligned
        The largest model in its world.
    deviations : dict of int to float
        Number of a lens to the standard deviation of its principal point.
    """
    model = aligned.model
    images = {image.name: image for image in model.images}
    member = {image.name: index for index, each in reversed(list(enumerate(models))) for image in each.images}
    photos = [
        _photo(photo.name, features[i], images.get(photo.name), model, member.get(photo.name), inliers[i], job)
        for i, photo in enumerate(job.photos)
    ]
    tracks = sum(len(image.points) for image in model.images)
    errors = np.concatenate([_errors(image, model) for image in model.images])
    lenses = [
        _lens(
            model,
            image.lens,
            starts[owner[_index(job, image.name)]],
            deviations.get(owner[_index(job, image.name)] + 1),
        )
        for image in _first_of_each_lens(model.images)
    ]
    shared = shared_of(model, [each["best_matches"] / each["features"] for each in photos if each["registered"]])
    return {
        "registered": len(model.images),
        "photos_given": len(job.photos),
        "points": len(model.xyz),
        "mean_track_length": tracks / len(model.xyz),
        "reprojection_error_px": {"mean": float(errors.mean()), "median": float(np.median(errors))},
        "units": aligned.units,
        "alignment": {"source": aligned.source, "how": aligned.words, **aligned.measured},
        "lenses": lenses,
        "photos": photos,
        "other_models": [[image.name for image in each.images] for each in models[1:]],
        "spacing": None if shared is None else shared.facts,
        "findings": _findings(job, features, inliers, photos, models, starts, shared),
        "peak_memory_bytes": peak_memory(),
    }


def _index(job: Job, name: str) -> int:
    return next(i for i, photo in enumerate(job.photos) if photo.name == name)


def _first_of_each_lens(images: Sequence[ModelImage]) -> list[ModelImage]:
    first: dict[int, ModelImage] = {}
    for image in images:
        first.setdefault(image.lens, image)
    return [first[lens] for lens in sorted(first)]


def _photo(
    name: str,
    found: Features,
    image: ModelImage | None,
    model: SparseModel,
    member: int | None,
    inliers: Array,
    job: Job,
) -> dict[str, Any]:
    best = int(inliers.argmax()) if inliers.any() else None
    return {
        "name": name,
        "registered": image is not None,
        "model": member,
        "features": len(found.keypoints),
        "points": 0 if image is None else len(image.points),
        "error_px": None if image is None or not len(image.points) else float(_errors(image, model).mean()),
        "best_partner": None if best is None else job.photos[best].name,
        "best_matches": 0 if best is None else int(inliers[best]),
    }


def _errors(image: ModelImage, model: SparseModel) -> Array:
    """Distances in pixels between where a photo's points are and where they should be."""
    local = model.xyz[image.points] @ image.cam_from_world[:, :3].T + image.cam_from_world[:, 3]
    errors: Array = np.linalg.norm(project(model.lenses[image.lens], local) - image.pixels, axis=1)
    return errors


def _lens(model: SparseModel, index: int, start: Start, deviation: float | None) -> dict[str, Any]:
    lens: Lens = model.lenses[index]
    return {
        "model": lens.model,
        "params": list(lens.params),
        "width": lens.width,
        "height": lens.height,
        "photos": sum(image.lens == index for image in model.images),
        "start": start.source,
        "start_params": list(start.lens.params),
        "angle_of_view_deg": angle_of_view(lens),
        "principal_point_deviation_px": deviation,
    }


def _findings(
    job: Job,
    features: Sequence[Features],
    inliers: Array,
    photos: Sequence[dict[str, Any]],
    models: Sequence[SparseModel],
    starts: Sequence[Start],
    shared: Shared | None,
) -> list[dict[str, str]]:
    findings = [_bridge(job, inliers, models[0], other) for other in models[1:]]
    for index, photo in enumerate(photos):
        if photo["registered"] or photo["model"] is not None:
            continue
        findings.append(_left_out(photo, features[index]))
    for photo in photos:
        if photo["registered"] and photo["points"] < WEAK:
            text = f"stands on {photo['points']} points only, its pose may be wrong"
            findings.append(_finding("warning", photo["name"], text, "take more photos close to this one"))
    if shared is not None and shared.too_wide:
        findings.append(_finding("warning", "photos", *words(shared, len(models[0].images))))
    if any(start.source == "guess" for start in starts):
        text = "no focal length in the photos' tags; it was found from a guess"
        findings.append(_finding("note", "lens", text, "nothing to do if the angle of view looks right"))
    return findings


def _finding(severity: str, file: str, text: str, remedy: str) -> dict[str, str]:
    return {"severity": severity, "file": file, "text": text, "remedy": remedy}


def _bridge(job: Job, inliers: Array, main: SparseModel, other: SparseModel) -> dict[str, str]:
    """Photos that hang together among themselves but not with the rest."""
    names = [photo.name for photo in job.photos]
    inside = [names.index(image.name) for image in main.images]
    outside = [names.index(image.name) for image in other.images]
    block = inliers[np.ix_(inside, outside)]
    i, j = np.unravel_index(int(block.argmax()), block.shape)
    text = f"{len(outside)} photos form a model of their own and are left out: {_listed([names[k] for k in outside])}"
    between = f"take photos between {names[inside[i]]} and {names[outside[j]]}, each overlapping the next by two thirds"
    return _finding("warning", names[outside[0]], text, between)


def _left_out(photo: dict[str, Any], found: Features) -> dict[str, str]:
    if found.covered == 0:
        return _finding("warning", photo["name"], "is left out: its mask keeps no pixel", "correct or remove the mask")
    if photo["features"] < WEAK:
        why = f"only {photo['features']} features" + (" inside its mask" if found.covered < 1 else "")
        return _finding(
            "warning", photo["name"], f"is left out: {why}", "take it again, sharp and with texture in view"
        )
    if photo["best_partner"] is None:
        remedy = "take more photos from close by, or remove it if it shows something else"
        return _finding("warning", photo["name"], "is left out: it shares nothing with any other photo", remedy)
    text = f"is left out: its best partner {photo['best_partner']} shares {photo['best_matches']} matches, too few"
    return _finding("warning", photo["name"], text, f"take photos between it and {photo['best_partner']}")


def _listed(names: Sequence[str], most: int = 5) -> str:
    shown = ", ".join(names[:most])
    return shown if len(names) <= most else f"{shown} and {len(names) - most} more"


def summary(document: Calibration) -> str:
    """Say in few lines what a calibration has come to."""
    error, lens, found = document.reprojection_error_px, document.lenses[0], document.alignment
    exact = "" if error is None else f"; error {error.mean:.2f} px"
    lines = [
        f"{document.registered} of {document.photos_given} photos calibrated; {document.points} points, each "
        f"in {document.mean_track_length or 0.0:.1f} photos{exact}",
        f"{len(document.lenses)} lens{'es' if len(document.lenses) > 1 else ''}: {lens.model}, "
        f"{lens.angle_of_view_deg:.1f} degrees wide, started from: {lens.start}",
        f"world: {found.how if found else None}; units: {document.units}",
    ]
    told = [f"{each.severity}: {each.file}: {each.text}; {each.remedy}" for each in document.findings]
    return "\n".join([*lines, *told]) + "\n"
