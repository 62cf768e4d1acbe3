"""The kernels of the relief renderer give the same pictures when Numba's compiler is off."""

from __future__ import annotations

import os
import subprocess
import sys

import numpy as np

SCRIPT = """
import numpy as np, sys
import ibrpipe, ibrpipe.types
rng = np.random.default_rng(11)
frame = ibrpipe.ParallelFrame((0, 0, 0), (1, 0, 0), (0, 1, 0.1), (0, 0, 1))
height = rng.random((6, 7)) * 2
height[2, 3] = np.nan
relief = ibrpipe.ReliefTexture(frame, rng.random((6, 7, 3)), height)
camera = ibrpipe.Camera.look_at((2, 1, -9), (3, 3, 1), width=13, height=11)
seen = [ibrpipe.render(relief, camera, renderer="relief", search=name) for name in ("exact", "linear-binary")]
uv = np.array([[[0, 2], [2, 2], [2, 0]], [[0, 2], [2, 0], [0, 0]]], float)
places = np.array([[-1, -1, 0], [1, -1, 0.1], [1, 1, 0], [-1, 1, 0]])
quad = ibrpipe.types.Mesh(places, np.array([[0, 1, 2], [0, 2, 3]]))
depths = rng.random((5, 6))
mesh = ibrpipe.ReliefMesh(quad, uv, depths, 0.3, back=depths - 0.3 * depths, color=rng.random((5, 4, 3)))
view = ibrpipe.Camera.look_at((0.5, -1.1, 1.2), (0, 0, 0), width=13, height=11)
for more in ({}, {"model": "shell"}, {"search": "linear-binary"}):
    seen.append(ibrpipe.render(mesh, view, renderer="relief", light=(2, 1, 3), **more))
np.savez(sys.argv[1], depth=[each.depth for each in seen], color=[each.color for each in seen])
"""


def run(path, **environment):
    subprocess.run([sys.executable, "-c", SCRIPT, str(path)], check=True, env={**os.environ, **environment})
    return np.load(path)


def test_compiled_equals_plain_python(tmp_path):
    compiled, plain = run(tmp_path / "a.npz"), run(tmp_path / "b.npz", NUMBA_DISABLE_JIT="1")
    assert np.isfinite(compiled["depth"]).sum() > 60
    np.testing.assert_allclose(compiled["depth"], plain["depth"], rtol=1e-5)
    np.testing.assert_allclose(compiled["color"], plain["color"], atol=1e-4)
