"""Speed of relief-mapped meshes beside the same polygons with a plain texture.

Run with ``pytest tests/benchmarks/test_relief_mesh_speed.py --benchmark-only``. A ball of 19,800 triangles in 640 x 480
pixels, about half of which it covers, with waves and blocks of 1024 x 1024 texels, 3 x 3 tiles, one lamp.
"""

from __future__ import annotations

import numpy as np
import pytest

import ibrpipe
from ibrpipe.io.surfaces.uv_maps import map_mesh
from ibrpipe.types import Camera, Mesh
from ibrpipe.types.relief_mesh import ReliefMesh

N = 1024
LAMP = {"light": (3.0, 4.0, 5.0)}
LOOKS = {
    "plain texture": {"mapping": "plain"},
    "plain texture, lit": {"mapping": "plain", **LAMP},
    "bump, lit": {"mapping": "bump", **LAMP},
    "parallax, lit": {"mapping": "parallax", **LAMP},
    "published 10 to 32 + 8, lit": {"search": "linear-binary", "shadows": False, **LAMP},
    "published 10 to 32 + 8, lit, shadows": {"search": "linear-binary", **LAMP},
    "exact, lit": {"shadows": False, **LAMP},
    "exact, lit, shadows": LAMP,
    "exact shell, lit, shadows": {"model": "shell", **LAMP},
}


@pytest.fixture(scope="module")
def prepared():
    """The ball, prepared."""
    theta, phi = np.meshgrid(np.linspace(0.01, np.pi - 0.01, 100), np.linspace(0, 2 * np.pi, 101), indexing="ij")
    points = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1)
    index = np.arange(theta.size).reshape(theta.shape)
    a, b, c, d = (each.ravel() for each in (index[:-1, :-1], index[:-1, 1:], index[1:, :-1], index[1:, 1:]))
    mesh = Mesh(points.reshape(-1, 3), np.concatenate([np.stack([a, c, b], 1), np.stack([b, c, d], 1)]))
    y, x = np.mgrid[:N, :N] / N
    height = 0.6 + 0.3 * np.sin(19 * x) * np.cos(17 * y)
    height[(np.abs(x % 0.25 - 0.12) < 0.04) & (np.abs(y % 0.25 - 0.12) < 0.04)] = 0.1
    color = np.stack([height, 1 - height, 0.5 + 0.5 * np.sin(90 * x)], axis=2)
    source = ReliefMesh(mesh, 3.0 * map_mesh(mesh, "cylinder", "z"), height, 0.06, color=color)
    return ibrpipe.prepare(source, "relief")


@pytest.mark.parametrize("look", LOOKS)
@pytest.mark.benchmark(group="relief-mapped ball, 640 x 480")
def test_frame(benchmark, prepared, look):
    view = Camera.look_at((2.2, -1.6, 1.0), (0, 0, 0), (0, 0, 1), 42.0, 640, 480)
    benchmark.pedantic(ibrpipe.render, (prepared, view, "relief"), LOOKS[look], rounds=9, warmup_rounds=2)
