"""The kernels of the epipolar renderer give the same depths when Numba's compiler is off."""

from __future__ import annotations

import os
import subprocess
import sys

import numpy as np
import pytest

SCRIPT = """
import numpy as np, sys
import ibrpipe
rng = np.random.default_rng(11)
frame = ibrpipe.ParallelFrame((0, 0, 0), (1, 0, 0), (0, 1, 0.1), (0, 0, 1))
height = rng.random((9, 12)) * 2
height[2, 3] = np.nan
relief = ibrpipe.ReliefTexture(frame, rng.random((9, 12, 3)), height)
reference = ibrpipe.Camera.look_at((3, 2, -9), (3, 3, 8), width=8, height=7)
depth = 14 + rng.random((7, 8))
depth[1, 1:3] = np.nan
image = ibrpipe.DepthImage(reference, rng.random((7, 8, 3)), depth)
found = {}
for search in ("exact", "nearest", "linear"):
    for name, camera in (
        ("front", ibrpipe.Camera.look_at((2.13, 1.07, -9.1), (4.1, 3.03, 1), width=13, height=11)),
        ("low", ibrpipe.Camera.look_at((-9.1, 2.13, -0.57), (4.1, 3.03, 1), width=13, height=11)),
    ):
        seen = ibrpipe.render([relief, image], camera, "epipolar", search=search)
        found[f"{search} {name} depth"], found[f"{search} {name} color"] = seen.depth, seen.color
np.savez(sys.argv[1], **found)
"""


def run(path, **environment):
    subprocess.run([sys.executable, "-c", SCRIPT, str(path)], check=True, env={**os.environ, **environment})
    return np.load(path)


@pytest.fixture(scope="module")
def both(tmp_path_factory):
    folder = tmp_path_factory.mktemp("plain")
    return run(folder / "a.npz"), run(folder / "b.npz", NUMBA_DISABLE_JIT="1")


@pytest.mark.parametrize("search", ["exact", "nearest", "linear"])
@pytest.mark.parametrize("view", ["front", "low"])
def test_compiled_equals_plain_python(both, search, view):
    compiled, plain = both
    name = f"{search} {view}"
    assert np.isfinite(compiled[name + " depth"]).sum() > 20
    np.testing.assert_allclose(compiled[name + " depth"], plain[name + " depth"], rtol=1e-6)
    np.testing.assert_allclose(compiled[name + " color"], plain[name + " color"], atol=1e-5)
