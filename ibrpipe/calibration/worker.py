"""What runs in the child process: ``python -m ibrpipe.calibration.worker JOB``."""

from __future__ import annotations

import json
import os
import sys
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import IO, Any

import numpy as np

from ibrpipe.calibration import mapping, pair_selection
from ibrpipe.calibration.alignment import AlignmentInputs, align_model
from ibrpipe.calibration.database import Matched, fill_database, match
from ibrpipe.calibration.features import Features, features_of
from ibrpipe.calibration.job import Job, read_job
from ibrpipe.calibration.lenses import Start, choose_lenses
from ibrpipe.calibration.results import figures
from ibrpipe.errors import CaptureError, IbrError
from ibrpipe.io.cameras.colmap_write import SparseModel, write_model

Say = Callable[[str, int, int], None]
#: COLMAP begins with two photos that share so many matches
ENOUGH = 100


def calibrate(job: Job, say: Say) -> dict[str, Any]:
    """Do the job: write the model into its folder of results and return the figures.

    Raises
    ------
    IbrError
        A photo cannot be read, or no photos hang together; the message says what to shoot.
    """
    features = _features(job, say)
    starts, owner = choose_lenses(job.photos, features, job.config)
    path = fill_database(features, starts, owner, job.seed, Path(job.work))
    chosen = _pairs(job, features)
    matched = match(path, features, chosen, job.seed, job.threads, lambda n: say("match photos", n, len(chosen)))
    fixed = _fixed(job, starts)
    models = _models(job, matched, starts, owner, fixed, say)
    if not models:
        raise CaptureError(_nothing(job, features, matched.inliers))
    say("adjust cameras", 0, 1)
    deviations = mapping.adjust(models[0], starts, fixed, _center(job))
    say("adjust cameras", 1, 1)
    names = [photo.name for photo in job.photos]
    sparse = [mapping.as_sparse_model(model, names, features) for model in models]
    inputs = AlignmentInputs(job, features, sparse[0])
    aligned = align_model(inputs)
    result = Path(job.result)
    _write(aligned.model, result, _wanted(job))
    return figures(job, features, starts, owner, matched.inliers, sparse, aligned, deviations)


def _features(job: Job, say: Say) -> list[Features]:
    folder = Path(job.work) / "features"
    folder.mkdir(parents=True, exist_ok=True)
    most, size = job.config["features"], job.config["max_size"]
    found = []
    with ThreadPoolExecutor(job.threads) as pool:
        say("find features", 0, len(job.photos))
        for index, each in enumerate(pool.map(lambda photo: features_of(photo, most, size, folder), job.photos)):
            found.append(each)
            say("find features", index + 1, len(job.photos))
    return found


def _pairs(job: Job, features: Sequence[Features]) -> list[pair_selection.Pair]:
    count, config = len(features), job.config
    kind = config["pairs"]
    if kind == "auto":
        kind = "exhaustive" if count <= pair_selection.EXHAUSTIVE else "near"
    if kind == "exhaustive":
        return pair_selection.all_pairs(count)
    similar = pair_selection.similar_pairs(
        [each.keypoints for each in features], [each.descriptors for each in features], config["neighbours"]
    )
    order = pair_selection.sequential_pairs(count, config["overlap"] if kind == "sequential" else 2)
    return sorted(set(similar) | set(order))


def _fixed(job: Job, starts: Sequence[Start]) -> set[int]:
    """Numbers of the cameras whose lens is taken as known."""
    wish = job.config["refine_intrinsics"]
    known = {key for key, start in enumerate(starts, 1) if start.source in ("given", "settings")}
    return {"yes": set[int](), "no": set(range(1, len(starts) + 1)), "auto": set() if job.refine else known}[wish]


def _center(job: Job) -> bool:
    return job.config["refine_principal_point"] != "no"


def _models(
    job: Job, matched: Matched, starts: Sequence[Start], owner: Sequence[int], fixed: set[int], say: Say
) -> list[Any]:
    if job.refine:
        poses = {i: np.reshape(photo.pose, (3, 4)) for i, photo in enumerate(job.photos) if photo.pose is not None}
        say("triangulate points", 0, 1)
        model = mapping.triangulate(matched.path, starts, owner, poses, job.seed)
        say("triangulate points", 1, 1)
        return [model] if model.num_points3D() >= 8 else []
    count, wish = len(job.photos), job.config["mapper"]
    say("place photos", 0, count)

    def placed(number: int) -> None:
        say("place photos", min(number, count), count)

    best: list[Any] = []
    possible = int((matched.inliers.max(axis=1, initial=0) > 0).sum())
    for mapper in ("incremental", "global") if wish == "auto" else (wish,):
        models = mapping.map_photos(matched.path, mapper, fixed, job.seed, placed)
        if models and models[0].num_reg_images() > (best[0].num_reg_images() if best else 0):
            best = models
        if best and best[0].num_reg_images() >= possible:
            break
    return best


def _nothing(job: Job, features: Sequence[Features], inliers: Any) -> str:
    """Say why no cameras were found at all, and what to shoot."""
    where = Path(job.photos[0].image).parent
    counts = [len(each.keypoints) for each in features]
    empty = [photo for photo, each in zip(job.photos, features) if photo.mask and each.covered == 0]
    if empty and len(empty) == len(features):
        return f"{empty[0].mask}: the masks keep no pixel of any photo; correct or remove them"
    if max(counts) < 30:
        what = "inside their masks " if any(photo.mask or photo.mask_from_alpha for photo in job.photos) else ""
        return (
            f"{where}: the photos show no features {what}(at most {max(counts)} in one photo, hundreds are needed); "
            "put textured things around the object or project a pattern, focus, and do not mask these things out"
        )
    if not inliers.any():
        best = "no two photos share anything"
    else:
        i, j = np.unravel_index(int(inliers.argmax()), inliers.shape)
        best = f"{job.photos[i].name} and {job.photos[j].name} share {inliers[i, j]} matches"
    return (
        f"{where}: no cameras could be found from the {len(features)} photos: {best}{_remedy(len(features), inliers)}"
    )


def _remedy(photos: int, inliers: Any) -> str:
    """What to shoot when no cameras were found; many matches are no use without an angle between the photos."""
    if inliers.max(initial=0) < ENOUGH:
        return (
            ", too few; take photos that overlap by two thirds, from places at most 15 degrees apart around the "
            "object, with texture in view"
        )
    places = "from places 5 to 15 degrees apart along an arc around the object, not turning on the spot"
    if photos == 2:
        return f", but two photos alone seldom fix their cameras; take at least 3, better 20, {places}"
    return (
        ", but no two make a start: they stand too close to each other, what they share is flat, or matches are wrong; "
        f"take more photos {places}"
    )


def _wanted(job: Job) -> set[bool]:
    """Say which cameras are to be written, held out (True) or not (False): by mode auto only those that are missing."""
    given = {photo.held_out for photo in job.photos if photo.pose is not None}
    return {True, False} - (given if job.config["mode"] == "auto" else set())


def _write(model: SparseModel, folder: Path, wanted: set[bool]) -> None:
    """Write the photos of ``images/``, and those of ``test/images/``, with names as their folder has them."""
    for held_out in sorted(wanted):
        names = [image.name for image in model.images if image.name.startswith("test/") == held_out]
        if names:
            half = model.only(names).renamed(lambda name: name.removeprefix("test/"))
            write_model(half, folder / ("test" if held_out else ".") / "sparse" / "0")


def main(path: str) -> int:
    """Run a job file; speak JSON lines on what was standard output, and leave it to native code to print elsewhere."""
    voice = os.fdopen(os.dup(1), "w", encoding="utf-8", buffering=1)
    os.dup2(2, 1)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    try:
        import cv2

        cv2.setNumThreads(1)
        job = read_job(Path(path))
        _tell(voice, "result", calibrate(job, lambda *step: _tell(voice, "progress", list(step))))
    except IbrError as error:
        _tell(voice, "error", [type(error).__name__, " ".join(str(error).split())])
    except MemoryError as error:
        _tell(voice, "error", ["ResourceError", f"not enough memory ({error}); set calibrate.max_size smaller"])
    return 0


def _tell(voice: IO[str], kind: str, value: Any) -> None:
    voice.write(json.dumps({kind: value}) + "\n")
    voice.flush()


def _end_with_parent() -> None:
    sys.stdin.buffer.read()
    os._exit(3)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
