"""Edges of faces and who is beside whom."""

from __future__ import annotations

import numpy as np

from ibrpipe.reconstruction.surface.mesh_operations import adjacency, face_areas, half_edges, vertex_normals
from ibrpipe.types import Mesh


def test_half_edges_run_as_their_faces_do():
    assert half_edges(np.array([[0, 1, 2], [2, 1, 3]])).tolist() == [[0, 1], [2, 1], [1, 2], [1, 3], [2, 0], [3, 2]]


def test_adjacency_counts_edges_in_both_directions():
    matrix = adjacency(np.array([[0, 1], [1, 2], [2, 1]]), 4)
    assert matrix.toarray().tolist() == [[0, 1, 0, 0], [1, 0, 2, 0], [0, 2, 0, 0], [0, 0, 0, 0]]


def test_areas_and_normals_of_two_triangles():
    mesh = Mesh(np.array([[0, 0, 0], [2, 0, 0], [0, 3, 0], [2, 0, 4.0]]), np.array([[0, 1, 2], [0, 3, 1]]))
    np.testing.assert_allclose(face_areas(mesh), [3.0, 4.0])
    normals = vertex_normals(mesh)
    np.testing.assert_allclose(normals[2], [0, 0, 1])  # only in the first, whose normal is +z
    np.testing.assert_allclose(normals[3], [0, 1, 0])  # only in the second
    np.testing.assert_allclose(normals[0], np.array([0, 8, 6]) / 10, rtol=1e-6)  # by area
