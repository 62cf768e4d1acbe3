"""COLMAP's database: features of all photos in it, and the matches between them. Runs in the child process only."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ibrpipe.calibration.features import Features
from ibrpipe.calibration.lenses import Start
from ibrpipe.calibration.matching import matching, may_share_geometry
from ibrpipe.calibration.pair_selection import Pair
from ibrpipe.native_imports import import_pycolmap
from ibrpipe.types import Array

#: Pairs that are matched between two reports of progress
BATCH = 24


@dataclass(frozen=True, eq=False)
class Matched:
    """A filled database. Photo i is its image i + 1 and is called by its number, whatever its file is called.

    Attributes
    ----------
    path : Path
    inliers : (N, N) int32
        Matches of each pair that a common geometry explains.
    """

    path: Path
    inliers: Array


def fill_database(
    features: Sequence[Features], starts: Sequence[Start], owner: Sequence[int], seed: int, work: Path
) -> Path:
    """Write lenses, photos and features; a database that holds just these, from an earlier run, is taken up again.

    Parameters
    ----------
    features : sequence of Features
    starts : sequence of Start
        Lenses.
    owner : sequence of int
        Lens of each photo.
    seed : int
        That of the matches to come.
    work : Path
        Folder of the database; databases of other photos are removed from it.
    """
    path = work / f"{_key(features, starts, owner, seed)}.db"
    for other in work.glob("*.db*"):
        if not other.name.startswith(path.name):
            other.unlink()
    if path.is_file() and path.with_suffix(".full").is_file():
        return path
    for stale in (path, path.with_suffix(".full")):
        stale.unlink(missing_ok=True)
    _fill(path, features, starts, owner)
    path.with_suffix(".full").touch()
    return path


def _fill(path: Path, features: Sequence[Features], starts: Sequence[Start], owner: Sequence[int]) -> None:
    pycolmap = import_pycolmap()
    database = pycolmap.Database.open(str(path))
    rigs = []
    for key, start in enumerate(starts, 1):
        rigs.append(_rig(database, make_camera(start, key)))
    for index, (found, lens) in enumerate(zip(features, owner)):
        key = database.write_image(pycolmap.Image(name=_name(index), camera_id=lens + 1))
        frame = pycolmap.Frame()
        frame.rig_id = rigs[lens]
        sensor = pycolmap.sensor_t(pycolmap.SensorType.CAMERA, lens + 1)
        frame.add_data_id(pycolmap.data_t(sensor, key))
        database.write_frame(frame)
        database.write_keypoints(key, found.keypoints)
        kind = pycolmap.FeatureExtractorType.SIFT
        database.write_descriptors(key, pycolmap.FeatureDescriptors(kind, found.descriptors))
    database.close()


def make_camera(start: Start, key: int) -> Any:
    """Return COLMAP's camera of a lens, numbered `key`."""
    pycolmap = import_pycolmap()
    lens = start.lens
    camera = pycolmap.Camera(model=lens.model, width=lens.width, height=lens.height, params=list(lens.params))
    camera.camera_id = key
    camera.has_prior_focal_length = start.trusted
    return camera


def _rig(database: Any, camera: Any) -> int:
    pycolmap = import_pycolmap()
    database.write_camera(camera, use_camera_id=True)
    rig = pycolmap.Rig()
    rig.add_ref_sensor(pycolmap.sensor_t(pycolmap.SensorType.CAMERA, camera.camera_id))
    return int(database.write_rig(rig))


def _name(index: int) -> str:
    return f"{index:06d}"


def match(
    path: Path,
    features: Sequence[Features],
    pairs: Sequence[Pair],
    seed: int,
    threads: int,
    progress: Callable[[int], None],
) -> Matched:
    """Match the pairs that are not matched yet and check each by a common geometry."""
    pycolmap = import_pycolmap()
    checking = pycolmap.TwoViewGeometryOptions()
    checking.ransac.random_seed = seed
    listed = path.with_suffix(".pairs")
    progress(0)
    for start in range(0, len(pairs), BATCH):
        batch = pairs[start : start + BATCH]
        worth = _write_matches(path, features, batch, threads)
        if worth:
            listed.write_text("".join(f"{_name(i)} {_name(j)}\n" for i, j in worth), encoding="utf-8")
            pycolmap.verify_matches(str(path), str(listed), checking)
        progress(min(start + BATCH, len(pairs)))
    return Matched(path, _inliers(path, len(features)))


def _write_matches(path: Path, features: Sequence[Features], pairs: Sequence[Pair], threads: int) -> list[Pair]:
    """Match what is not matched yet; return the pairs whose matches may have a common geometry."""

    def matches(pair: Pair) -> Array:
        one, other = (features[n].descriptors.astype(np.float32) for n in pair)
        return matching(one, other)

    def hopeful(pair: Pair, matched: Array) -> bool:
        one, other = (features[n].keypoints[matched[:, k], :2] for k, n in enumerate(pair))
        return may_share_geometry(one, other)

    database = import_pycolmap().Database.open(str(path))
    missing = [(i, j) for i, j in pairs if not database.exists_matches(i + 1, j + 1)]
    with ThreadPoolExecutor(threads) as pool:
        for (i, j), found in zip(missing, pool.map(matches, missing)):
            database.write_matches(i + 1, j + 1, found)
        stored = [np.asarray(database.read_matches(i + 1, j + 1)) for i, j in pairs]
        hopes = list(pool.map(hopeful, pairs, stored))
    database.close()
    return [pair for pair, hope in zip(pairs, hopes) if hope]


def _inliers(path: Path, count: int) -> Array:
    pycolmap = import_pycolmap()
    database = pycolmap.Database.open(str(path))
    pairs, numbers = database.read_two_view_geometry_num_inliers()
    database.close()
    inliers = np.zeros((count, count), np.int32)
    for pair, number in zip(pairs, numbers):
        i, j = (int(key) - 1 for key in pycolmap.pair_id_to_image_pair(pair))
        inliers[i, j] = inliers[j, i] = number
    return inliers


def _key(features: Sequence[Features], starts: Sequence[Start], owner: Sequence[int], seed: int) -> str:
    """Hash of all that the database holds."""
    found = hashlib.blake2b(digest_size=12)
    lenses = [[start.lens.model, list(start.lens.params), start.lens.width, start.source] for start in starts]
    found.update(json.dumps([lenses, list(owner), seed, import_pycolmap().__version__]).encode())
    for each in features:
        found.update(each.keypoints.tobytes())
        found.update(each.descriptors.tobytes())
    return found.hexdigest()
