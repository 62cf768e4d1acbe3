"""The kernels of the ray search give the same depths when Numba's compiler is off."""

from __future__ import annotations

import os
import subprocess
import sys

import numpy as np

SCRIPT = """
import numpy as np, sys
import ibrpipe
rng = np.random.default_rng(11)
frame = ibrpipe.ParallelFrame((0, 0, 0), (1, 0, 0), (0, 1, 0.1), (0, 0, 1))
relief = ibrpipe.ReliefTexture(frame, rng.random((6, 7, 3)), rng.random((6, 7)) * 2)
counts = rng.integers(0, 3, 30)
ends = np.cumsum(counts).reshape(5, 6)
offsets = np.concatenate([np.r_[0, ends[:-1, -1]][:, None], ends], 1)
depth = np.concatenate([np.sort(rng.random(k) * 3) for k in counts])
layers = ibrpipe.LayeredDepthImage(frame, offsets, depth, rng.random((len(depth), 3)), np.full((len(depth), 3), np.nan))
camera = ibrpipe.Camera.look_at((2, 1, -9), (3, 3, 1), width=13, height=11)
seen = ibrpipe.render([relief, layers], camera)
np.savez(sys.argv[1], depth=seen.depth, color=seen.color)
"""


def run(path, **environment):
    subprocess.run([sys.executable, "-c", SCRIPT, str(path)], check=True, env={**os.environ, **environment})
    return np.load(path)


def test_compiled_equals_plain_python(tmp_path):
    compiled, plain = run(tmp_path / "a.npz"), run(tmp_path / "b.npz", NUMBA_DISABLE_JIT="1")
    assert np.isfinite(compiled["depth"]).sum() > 40
    np.testing.assert_allclose(compiled["depth"], plain["depth"], rtol=1e-6)
    np.testing.assert_allclose(compiled["color"], plain["color"], atol=1e-5)
