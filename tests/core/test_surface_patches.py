"""Patches of meshes: closed, open, wound anyhow, non-manifold, Moebius strips; against a walk from face to face."""

from __future__ import annotations

import numpy as np
import pytest

from ibrpipe.core.normals import weld
from ibrpipe.core.surface_patches import patches
from ibrpipe.synthetic.surfaces import ball, lobed_ball, sheet, tilt, torus, tube


def grid(z=0.0, turn=0.0):
    return sheet(lambda u, v: np.stack([u, v, z + turn * u * v], axis=-1), 5, 4).mesh


def joined(*meshes):
    starts = np.cumsum([0] + [len(mesh.vertices) for mesh in meshes])
    vertices = np.concatenate([mesh.vertices for mesh in meshes])
    return vertices, np.concatenate([mesh.faces + start for mesh, start in zip(meshes, starts, strict=False)])


def scrambled(faces, seed):
    turned = np.random.default_rng(seed).random(len(faces)) < 0.5
    return np.where(turned[:, None], faces[:, ::-1], faces), turned


def strip(twisted):
    """A band of ten quads; twisted by half a turn it is a Moebius strip."""
    angle = np.arange(10) * 2 * np.pi / 10
    tilted = angle / 2 if twisted else np.zeros(10)
    across = np.stack([np.cos(tilted) * np.cos(angle), np.cos(tilted) * np.sin(angle), np.sin(tilted)], axis=1)
    middle = np.stack([3 * np.cos(angle), 3 * np.sin(angle), 0 * angle], axis=1)
    a, b = np.arange(10), 10 + np.arange(10)
    c, d = np.roll(a, -1).copy(), np.roll(b, -1).copy()
    if twisted:
        c[-1], d[-1] = d[-1], c[-1]
    faces = np.concatenate([np.stack([a, b, d], axis=1), np.stack([a, d, c], axis=1)])
    return np.concatenate([middle - across, middle + across]), faces


def twin(vertices, faces):
    """Walk over edges of exactly two faces: patch of every face, and winding against the first face of its patch."""
    corners = weld(vertices)[faces]
    edges: dict[tuple[int, int], list[tuple[int, bool]]] = {}
    for face, triple in enumerate(corners):
        for one, two in zip(triple, np.roll(triple, -1), strict=True):
            edges.setdefault((min(one, two), max(one, two)), []).append((face, one < two))
    patch, against, count = np.full(len(faces), -1), np.zeros(len(faces), bool), 0
    for start in range(len(faces)):
        if patch[start] >= 0:
            continue
        patch[start], todo = count, [start]
        while todo:
            face = todo.pop()
            for pair in edges.values():
                if len(pair) == 2 and face in (pair[0][0], pair[1][0]):
                    other = pair[1][0] if pair[0][0] == face else pair[0][0]
                    if patch[other] < 0:
                        patch[other], against[other] = count, against[face] != (pair[0][1] == pair[1][1])
                        todo.append(other)
        count += 1
    return patch, against


def same_parts(one, two):
    return len(np.unique(np.stack([one, two]), axis=1).T) == len(np.unique(one)) == len(np.unique(two))


@pytest.mark.parametrize("seed", [0, 1])
def test_patches_equal_a_walk_over_the_edges(seed):
    vertices, faces = joined(grid(), grid(1.0, 0.3), tube(torus(1, 0.3, np.eye(3), (0, 0, 5)), 8, 5).mesh)
    faces, _ = scrambled(faces, seed)
    patch, against, closed = patches(vertices, faces)
    want, wound = twin(vertices, faces)
    assert same_parts(patch, want)
    for number in range(3):
        own = patch == number
        assert len(np.unique(against[own] ^ wound[own])) == 1
        assert 2 * against[own].sum() <= own.sum()  # against the most of them
    assert sorted(closed) == [False, False, True]


def test_a_closed_body_wound_by_chance_is_one_patch_and_comes_right():
    mesh = ball(lobed_ball(1.0, 3, 0.1, 0.8), 12, 8).mesh
    faces, turned = scrambled(mesh.faces, 4)
    patch, against, closed = patches(mesh.vertices @ tilt("x", 20.0), faces)
    assert (patch == 0).all()
    assert closed.tolist() == [True]
    assert (against == turned).all() or (against == ~turned).all()


def test_seams_are_welded_and_holes_make_a_body_open():
    mesh = ball(lobed_ball(1.0, 3, 0.1, 0.8), 12, 8).mesh
    soup = mesh.vertices[mesh.faces].reshape(-1, 3), np.arange(3 * len(mesh.faces)).reshape(-1, 3)
    assert patches(*soup)[2].tolist() == [True]
    assert patches(soup[0], soup[1][1:])[2].tolist() == [False]


def test_three_faces_at_an_edge_are_three_patches():
    vertices = np.array([[0, 0, 0], [0, 0, 1], [1, 0, 0], [-1, 0, 0], [0, 1, 0]], float)
    patch, _, closed = patches(vertices, np.array([[0, 1, 2], [0, 1, 3], [0, 1, 4]]))
    assert len(set(patch.tolist())) == 3
    assert not closed.any()


def test_a_moebius_strip_is_one_patch_wound_as_it_is():
    for twisted in (False, True):
        patch, against, closed = patches(*strip(twisted))
        assert (patch == 0).all()
        assert not against.any()
        assert not closed.any()


def test_faces_that_repeat_another_have_no_patch():
    mesh = grid()
    faces = np.concatenate([mesh.faces, mesh.faces[:7, ::-1], mesh.faces[3:5]])
    patch, _, closed = patches(mesh.vertices, faces)
    assert (patch[: len(mesh.faces)] == 0).all()
    assert (patch[len(mesh.faces) :] == -1).all()
    assert closed.tolist() == [False]


def test_a_triangle_without_area_opens_no_closed_body():
    mesh = ball(lobed_ball(1.0, 3, 0.1, 0.8), 12, 8).mesh
    a, b = mesh.faces[5, :2]
    faces = np.concatenate([mesh.faces, [[a, b, b], [a, a, a]]])
    patch, _, closed = patches(mesh.vertices, faces)
    assert (patch[:-2] == 0).all()
    assert patch[-2:].tolist() == [-1, -1]
    assert closed.tolist() == [True]
