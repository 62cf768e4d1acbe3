"""Speed of `ldi` beside Embree: a height field of 1024 x 1024 texels, and the six faces of a vase.

Run with ``pytest tests/benchmarks/test_ldi_speed.py --benchmark-only``; Embree is called through Open3D.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

import ibrpipe
from ibrpipe.embree import MeshCaster
from ibrpipe.types import Camera, LayeredDepthImage, Mesh, ParallelFrame, ReliefTexture

EYES = {"frontal": (0.5, 0.5, 1.3), "oblique": (0.85, -0.48, 0.65), "grazing": (0.94, -0.72, 0.16)}


@pytest.fixture(scope="module")
def heights():
    """(1024, 1024) float32 rough heights with steps, 0 to 0.15."""
    rng = np.random.default_rng(7)
    n = 1024
    frequency = np.hypot(np.fft.fftfreq(n)[:, None] * n, np.fft.rfftfreq(n)[None] * n)
    frequency[0, 0] = np.inf
    height = np.fft.irfft2(np.fft.rfft2(rng.standard_normal((n, n))) * frequency**-1.6)
    height += 0.4 * height.std() * (rng.random((16, 16)) > 0.7).repeat(n // 16, 0).repeat(n // 16, 1)
    return ((height - height.min()) / np.ptp(height) * 0.15).astype(np.float32)


@pytest.fixture(scope="module")
def relief(heights):
    n = len(heights)
    p = 1.0 / (n - 1)
    frame = ParallelFrame((-p / 2, -p / 2, 0), (p, 0, 0), (0, p, 0), (0, 0, 1))
    return ibrpipe.prepare(ReliefTexture(frame, np.zeros((n, n, 3)), heights))


@pytest.mark.parametrize("view", EYES)
@pytest.mark.benchmark(group="height field, 640x480")
def test_relief(benchmark, relief, view):
    camera = Camera.look_at(EYES[view], (0.5, 0.5, 0.05), up=(0, 1, 0), width=640, height=480)
    benchmark.pedantic(ibrpipe.render, (relief, camera), {"outputs": "depth"}, rounds=7, warmup_rounds=1)


@pytest.mark.parametrize("view", EYES)
@pytest.mark.benchmark(group="height field, 640x480")
def test_relief_by_embree(benchmark, heights, view):
    n = len(heights)
    y, x = np.mgrid[:n, :n] / (n - 1)
    corner = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    faces = np.stack([corner, corner + 1, corner + n + 1, corner, corner + n + 1, corner + n], 1).reshape(-1, 3)
    caster = MeshCaster(Mesh(np.stack([x, y, heights], -1).reshape(-1, 3), faces))
    camera = Camera.look_at(EYES[view], (0.5, 0.5, 0.05), up=(0, 1, 0), width=640, height=480)
    benchmark.pedantic(caster.cast_camera, (camera,), rounds=7, warmup_rounds=1)


def face_layers(mesh: Mesh, texels: int = 250, steepest_deg: float = 70.0) -> list[LayeredDepthImage]:
    """Layered depth images of a mesh from the six faces of its bounding box, `texels` along the longest side."""
    caster, low, high = MeshCaster(mesh), mesh.vertices.min(0), mesh.vertices.max(0)
    texel, made = (high - low).max() / texels, []
    for axis in range(3):
        for sign in (1, -1):
            u, v = [k for k in range(3) if k != axis][::sign]
            a, b, f = texel * np.eye(3)[u], texel * np.eye(3)[v], -sign * np.eye(3)[axis]
            columns, rows = (int(np.ceil((high - low)[k] / texel)) for k in (u, v))
            origin = (low + high) / 2 - a * columns / 2 - b * rows / 2 - f * ((high - low)[axis] / 2 + texel)
            y, x = np.mgrid[:rows, :columns] + 0.5
            starts = (origin + x[..., None] * a + y[..., None] * b).reshape(-1, 3)
            ray, hits = caster.cast_all(starts, np.broadcast_to(f, starts.shape))
            keep = hits.normal @ f < -np.cos(np.radians(steepest_deg))
            ends = np.cumsum(np.bincount(ray[keep], minlength=rows * columns)).reshape(rows, columns)
            offsets = np.concatenate([np.r_[0, ends[:-1, -1]][:, None], ends], 1)
            normal = hits.normal[keep]
            frame = ParallelFrame(origin, a, b, f)
            made.append(LayeredDepthImage(frame, offsets, hits.t[keep], np.abs(normal), normal))
    return made


@pytest.fixture(scope="module")
def vase():
    from ibrpipe.io.surfaces.meshes import read_mesh

    path = Path(os.environ.get("IBRPIPE_DATA", "")) / "captures" / "shiny_vase" / "mesh.ply"
    if not path.is_file():
        pytest.skip("set IBRPIPE_DATA to the folder of the shared data sets")
    mesh = read_mesh(path)
    center = (mesh.vertices.min(0) + mesh.vertices.max(0)) / 2
    eye = center + np.array((1.7, 0.8, 0.7)) * np.linalg.norm(mesh.vertices.max(0) - center)
    return mesh, Camera.look_at(eye, center, fov_y_deg=45, width=640, height=480)


@pytest.mark.real
@pytest.mark.benchmark(group="six layered images, 640x480, depth and colour")
def test_asset(benchmark, vase):
    mesh, camera = vase
    prepared = ibrpipe.prepare(face_layers(mesh))
    frame = benchmark.pedantic(
        ibrpipe.render, (prepared, camera), {"outputs": ("color", "depth")}, rounds=7, warmup_rounds=1
    )
    truth = MeshCaster(mesh).cast_camera(camera).t
    assert np.mean(np.isfinite(frame.depth) != np.isfinite(truth)) < 1e-3


@pytest.mark.real
@pytest.mark.benchmark(group="six layered images, 640x480, depth and colour")
def test_asset_by_embree(benchmark, vase):
    mesh, camera = vase
    benchmark.pedantic(MeshCaster(mesh).cast_camera, (camera,), rounds=7, warmup_rounds=1)
