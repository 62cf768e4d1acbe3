"""Every number of an asset's files, replaced by what a hostile hand would write: told, or rendered; never a crash."""

import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np

from ibrpipe import Asset, LayeredDepthImage, ParallelFrame, Texture
from ibrpipe.core.spiral import directions
from ibrpipe.io.assets import write_asset
from ibrpipe.types import SpiralResiduals

SIZE, CHILD = 6, Path(__file__).with_name("hostile_child.py")


def layers():
    """Two layers on 6 x 6 texels of the unit square, z = 0.3 and 0.6."""
    count = 2 * SIZE * SIZE
    frame = ParallelFrame((0, 0, 0), (1 / SIZE, 0, 0), (0, 1 / SIZE, 0), (0, 0, 1))
    offsets = np.arange(0, 2 * SIZE + 1, 2)[None] + 2 * SIZE * np.arange(SIZE)[:, None]
    normal = np.tile(np.float32([0, 0, -1]), (count, 1))
    depth = np.tile(np.float32([0.3, 0.6]), count // 2)
    return LayeredDepthImage(frame, offsets, depth, np.full((count, 3), 0.5, np.float32), normal)


def spiral():
    """Residuals of 2 x 2 texels in every direction."""
    alphas = directions.table(0.25)
    count = len(alphas)
    frame = ParallelFrame((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1))
    ways, sizes = directions.directions(alphas, 0.25), np.full((count, 2), 2, np.int32)
    texels, valid = np.full((4 * count, 3), 40, np.uint8), np.ones(4 * count, bool)
    return SpiralResiduals(frame, 0.25, alphas, ways, sizes, 4 * np.arange(count + 1), texels, valid)


def outcomes(folder, tmp_path):
    """Return what became of every case, in a child that starts again after each signal."""
    found, first = [], 0
    while True:
        copy = tmp_path / f"copy_{first}"
        shutil.copytree(folder, copy)
        child = subprocess.run(
            [sys.executable, str(CHILD), str(copy), str(first)], capture_output=True, text=True, check=False
        )
        lines = child.stdout.splitlines()
        found += lines
        if child.returncode == 0:
            return found
        assert lines, child.stderr
        found[-1] += f"ended by {child.returncode}"
        first = int(lines[-1].split()[0]) + 1


def test_hostile_numbers_are_told(tmp_path):
    write_asset(Asset((Texture(layers(), (spiral(),)),)), tmp_path / "asset")
    lines = outcomes(tmp_path / "asset", tmp_path)
    assert len(lines) > 100
    ends = [line.partition(" -> ")[2] for line in lines]
    assert {"told", "rendered"} <= set(ends)
    assert [line for line, end in zip(lines, ends, strict=True) if end not in ("told", "rendered")] == []
