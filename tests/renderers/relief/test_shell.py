"""Relief-mapped meshes with carved silhouettes against brute force over all tetrahedra of their shell, in float64."""

from __future__ import annotations

import numpy as np
import pytest
import relief_mesh_twin as twin

import ibrpipe
from ibrpipe import Camera, ReliefMesh
from ibrpipe.types import Mesh

QUAD = Mesh(np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], float), np.array([[0, 1, 2], [0, 2, 3]]))
QUAD_UV = np.array([[[0, 1], [1, 1], [1, 0]], [[0, 1], [1, 0], [0, 0]]], float)
OCTA = Mesh(
    np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], float),
    np.array([[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]]),
)


def rough(shape, seed=3):
    return np.random.default_rng(seed).random(shape).astype(np.float32)


def octa(height, thickness=0.3, edges="wrap"):
    """A closed mesh; every face carries one texture's half, so textures end at each edge."""
    return ReliefMesh(OCTA, np.tile([[0.0, 1.0], [1.0, 1.0], [0.5, 0.0]], (8, 1, 1)), height, thickness, edges=edges)


def check(source, view, flips=0.01, rtol=1e-6):
    wanted = twin.cast_shell(source, view)
    frame = ibrpipe.render(source, view, "relief", model="shell", light=(3, 4, 5))
    assert np.isfinite(wanted).any()
    assert not np.isnan(frame.depth).any()
    assert np.isfinite(frame.color).all()
    assert np.mean(~np.isclose(frame.depth, wanted, rtol=rtol)) <= flips
    return frame


@pytest.mark.parametrize("eye", [(0.8, -1.5, 1.1), (0.3, 0.2, 2.0), (0.0, -3.0, 0.02), (2.5, 2.5, -0.1)])
@pytest.mark.parametrize("edges", ["wrap", "cut"])
def test_slab_equals_brute_force(eye, edges):
    source = ReliefMesh(QUAD, QUAD_UV, rough((7, 9)), 0.4, edges=edges)
    check(source, Camera.look_at(eye, (0, 0, -0.2), width=26, height=20), flips=0.015)


@pytest.mark.parametrize("eye", [(2.6, 1.0, 1.4), (-0.3, 2.9, 0.1), (0.1, 0.2, -2.5)])
def test_closed_mesh_equals_brute_force(eye):
    check(octa(rough((6, 6))), Camera.look_at(eye, (0, 0, 0), width=26, height=22), flips=0.015)


def test_silhouettes_follow_the_relief():
    """Of a relief that is deep everywhere only the inner surface is left, smaller than the polygons."""
    view = Camera.look_at((2.6, 1.0, 1.4), (0, 0, 0), width=60, height=50)
    flat = ibrpipe.render(octa(np.zeros((4, 4), np.float32)), view, "relief")
    shell = ibrpipe.render(octa(np.zeros((4, 4), np.float32)), view, "relief", model="shell")
    full = ibrpipe.render(octa(np.ones((4, 4), np.float32)), view, "relief", model="shell")
    np.testing.assert_array_equal(full.alpha, flat.alpha)
    assert 0.3 < shell.alpha.sum() / flat.alpha.sum() < 0.8


def test_eye_inside_the_shell_sees_the_relief_before_it():
    height = np.zeros((16, 16), np.float32)
    height[:, 12:] = 1.0
    source = ReliefMesh(QUAD, QUAD_UV, height, 0.4)
    view = Camera.look_at((-0.5, 0.0, -0.2), (0.5, 0.01, -0.2), width=24, height=18, fov_y_deg=20)
    frame = check(source, view)
    middle = frame.depth[9, 12] - 0.5
    assert 0.4 < middle < 0.55  # the step between the columns whose centres are at x = 0.4375 and 0.5625


def test_moved_vertices_and_threads():
    source = octa(rough((6, 6)))
    moved = OCTA.vertices * (1.2, 0.7, 1.0) + 0.1
    view = Camera.look_at((2.6, 1.0, 1.4), (0, 0, 0), width=60, height=50)
    one = ibrpipe.render(source, view, "relief", model="shell", vertices=moved, threads=1)
    other = ibrpipe.render(source.with_vertices(moved), view, "relief", model="shell")
    assert one.depth.tobytes() == other.depth.tobytes()
    assert one.color.tobytes() == other.color.tobytes()


def test_baselines_have_no_shell():
    with pytest.raises(ibrpipe.IbrError, match="model 'shell' shows a relief"):
        ibrpipe.render(
            octa(rough((6, 6))), Camera.look_at((3, 0, 0), (0, 0, 0)), "relief", model="shell", mapping="bump"
        )
