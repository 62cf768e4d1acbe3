"""Time of the check of pairs, with the quick look before it and without: python docs/figures/pair_check.py RUN [EVERY].

RUN is the folder of an `ibrpipe calibrate`; every EVERY-th pair of photos is checked again in a copy of its matches.
"""

import shutil
import sqlite3
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import cv2
import numpy as np

from ibrpipe.calibration.matching import may_share_geometry
from ibrpipe.native_imports import import_pycolmap

pycolmap = import_pycolmap()
pycolmap.logging.minloglevel = 2
cv2.setNumThreads(1)
(stored,) = Path(sys.argv[1]).glob(".calibrate.work/*.db")
every = int(sys.argv[2]) if len(sys.argv) > 2 else 1
database = pycolmap.Database.open(str(stored))
pairs = [tuple(pycolmap.pair_id_to_image_pair(key)) for key in sorted(database.read_all_matches()[0])][::every]
matches = {pair: np.asarray(database.read_matches(*pair)) for pair in pairs}
places = {key: np.asarray(database.read_keypoints(key))[:, :2] for key in {key for pair in pairs for key in pair}}
database.close()


def hopeful(pair: tuple[int, int]) -> bool:
    """Say whether the quick look lets a pair through."""
    return may_share_geometry(*(places[key][matches[pair][:, k]] for k, key in enumerate(pair)))


def check(chosen: list[tuple[int, int]]) -> dict[tuple[int, int], int]:
    """Let COLMAP check pairs; return how many matches of each agree."""
    with tempfile.TemporaryDirectory() as folder:
        copy, listed = Path(folder, "copy.db"), Path(folder, "pairs.txt")
        shutil.copyfile(stored, copy)
        with sqlite3.connect(copy) as link:
            link.execute("delete from two_view_geometries")
        listed.write_text("".join(f"{one - 1:06d} {other - 1:06d}\n" for one, other in chosen))
        options = pycolmap.TwoViewGeometryOptions()
        options.ransac.random_seed = 0
        pycolmap.verify_matches(str(copy), str(listed), options)
        filled = pycolmap.Database.open(str(copy))
        keys, counts = filled.read_two_view_geometry_num_inliers()
        filled.close()
    return {tuple(pycolmap.pair_id_to_image_pair(key)): count for key, count in zip(keys, counts)}


start = time.perf_counter()
with ThreadPoolExecutor(2) as pool:
    chosen = [pair for pair, hope in zip(pairs, pool.map(hopeful, pairs)) if hope]
looked = time.perf_counter()
some = check(chosen)
sys.stdout.write(f"{len(pairs)} pairs; the quick look lets {len(chosen)} through in {looked - start:.1f} s\n")
sys.stdout.write(
    f"COLMAP's check of these: {time.perf_counter() - looked:.1f} s, {len(some)} pairs, {sum(some.values())} matches\n"
)
start = time.perf_counter()
every_one = check(pairs)
sys.stdout.write(
    f"of all: {time.perf_counter() - start:.1f} s; {'the same result' if every_one == some else 'another result'}\n"
)
