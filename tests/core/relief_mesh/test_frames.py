"""Axes of faces and frames of corners against their twins: creases, seams, mirrored and degenerate coordinates."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
import relief_mesh_twin as twin
from kernel_runs import on_all_thread_counts
from relief_mesh_scene import bent_sheet

from ibrpipe.core.normals import incidence
from ibrpipe.core.relief_mesh.frames import FACE_SIZE, corner_frames, face_axes
from ibrpipe.types import Mesh


def sheet():
    """A bent sheet with a seam, a mirrored face, and faces that have no mapping."""
    mesh, uv = bent_sheet()
    uv = uv.copy()
    uv[3] = uv[3] * (-1, 1)
    uv[7], uv[11, 1] = uv[7, 0], uv[11, 0]
    uv[5] += (2, -1)  # whole textures away: no seam
    uv[9] += (0.3, 0)
    return SimpleNamespace(mesh=mesh, uv=uv)


def axes_of(source):
    out = np.empty((len(source.mesh.faces), FACE_SIZE))
    face_axes(source.mesh.vertices, source.mesh.faces.astype(np.int64), source.uv, out)
    return out


def frames_of(source, crease_deg, smooth=False):
    corners = source.mesh.faces.astype(np.int64)
    starts, around = incidence(corners, len(source.mesh.vertices))
    out = np.full((len(corners), 3, 9), np.nan, np.float32)
    corner_frames(corners, source.uv, starts, around, axes_of(source), np.cos(np.radians(crease_deg)), smooth, out)
    return out


def test_axes_of_faces_are_solved_from_their_edges():
    source = sheet()
    source.mesh = Mesh(source.mesh.vertices, np.concatenate([source.mesh.faces, [[1, 1, 1]]]))  # no area
    source.uv = np.concatenate([source.uv, source.uv[:1]])
    (found,) = on_all_thread_counts(lambda: (axes_of(source),))
    for face, uv, row in zip(source.mesh.faces, source.uv, found):
        p = source.mesh.vertices[face]
        normal, edges = np.cross(p[1] - p[0], p[2] - p[0]), uv[1:] - uv[0]
        np.testing.assert_allclose(row[:3], twin.unit(normal), atol=1e-12)
        sound = abs(np.linalg.det(edges)) > 1e-9 and np.linalg.norm(normal) > 0
        wanted = np.linalg.solve(edges, p[1:] - p[0]) if sound else np.zeros((2, 3))
        np.testing.assert_allclose(row[3:9].reshape(2, 3), wanted, atol=1e-9)
        assert row[12] == (np.sign(np.linalg.det(edges)) if sound else 0)
        if np.linalg.norm(normal) > 0:
            assert row[9:12].sum() == pytest.approx(np.pi)
            one, other = twin.unit(p[1] - p[0]), twin.unit(p[2] - p[0])
            assert row[9] == pytest.approx(np.arccos(one @ other))
    assert set(found[:, 12]) == {-1, 0, 1}


@pytest.mark.parametrize("crease", [1.0, 20.0, 40.0, 90.0])
def test_frames_of_corners_are_those_of_the_twin(crease):
    source = sheet()
    (found,) = on_all_thread_counts(lambda: (frames_of(source, crease),))
    wanted = twin.corner_axes(source, crease)
    np.testing.assert_allclose(found.reshape(wanted.shape), wanted, atol=2e-6)


def test_smooth_normals_heed_no_crease():
    source = sheet()
    found = frames_of(source, 1.0, smooth=True)
    np.testing.assert_allclose(found[:, :, :3], twin.smooth_normals(source)[source.mesh.faces], atol=2e-6)


def test_no_faces():
    mesh = SimpleNamespace(vertices=np.zeros((3, 3)), faces=np.zeros((0, 3), np.int32))
    none = SimpleNamespace(mesh=mesh, uv=np.zeros((0, 3, 2)))
    assert axes_of(none).shape == (0, FACE_SIZE)
    assert frames_of(none, 40.0).shape == (0, 3, 9)
