"""The tree of boxes over a shell's prisms: leaves and inner nodes against their prisms, one by one."""

from __future__ import annotations

import numpy as np
import pytest
from kernel_runs import on_all_thread_counts

from ibrpipe.core.relief_mesh.tree import LEAF, count_leaves, fit_boxes, fit_leaves, fit_level, sort_faces


def prisms(faces, seed=0):
    rng = np.random.default_rng(seed)
    vertices, normals = rng.normal(size=(faces + 2, 3)), rng.normal(size=(faces + 2, 3))
    return vertices, normals, rng.integers(0, faces + 2, (faces, 3))


@pytest.mark.parametrize("faces", [1, 4, 5, 23])
def test_leaves_hold_the_tops_and_bottoms_of_their_prisms(faces):
    vertices, normals, corners = prisms(faces)
    order, leaves = sort_faces(vertices, corners), count_leaves(faces)
    assert sorted(order) == list(range(faces))
    boxes = np.full((2 * leaves - 1, 6), np.nan)
    (found,) = on_all_thread_counts(
        lambda: (fit_leaves(vertices, normals, corners, 0.3, order, leaves, boxes), boxes.copy())[1:]
    )
    assert np.isnan(found[: leaves - 1]).all()
    for leaf in range(leaves):
        own = corners[order[LEAF * leaf : LEAF * leaf + LEAF]].ravel()
        places = np.concatenate([vertices[own], vertices[own] - 0.3 * normals[own]])
        box = found[leaves - 1 + leaf]
        if not len(own):  # a leaf without prisms is met by no ray
            assert (box[:3] == np.inf).all()
            assert (box[3:] == -np.inf).all()
            continue
        assert (box[:3] < places.min(axis=0)).all()
        assert (box[3:] > places.max(axis=0)).all()
        np.testing.assert_allclose(box, [*places.min(axis=0), *places.max(axis=0)], atol=1e-7)


def test_a_level_holds_its_children():
    rng = np.random.default_rng(1)
    low = rng.normal(size=(15, 3))
    boxes = np.concatenate([low, low + rng.random((15, 3))], axis=1)
    boxes[14] = [np.inf] * 3 + [-np.inf] * 3
    before = boxes.copy()
    fit_level(3, 4, boxes)
    for node in range(3, 7):
        one, other = before[2 * node + 1], before[2 * node + 2]
        np.testing.assert_array_equal(boxes[node, :3], np.minimum(one[:3], other[:3]))
        np.testing.assert_array_equal(boxes[node, 3:], np.maximum(one[3:], other[3:]))
    np.testing.assert_array_equal(np.delete(boxes, range(3, 7), axis=0), np.delete(before, range(3, 7), axis=0))


def test_the_root_holds_everything():
    vertices, normals, corners = prisms(23)
    boxes = fit_boxes(vertices, normals, corners, 0.3, sort_faces(vertices, corners))
    used = np.unique(corners)
    places = np.concatenate([vertices[used], vertices[used] - 0.3 * normals[used]])
    np.testing.assert_allclose(boxes[0], [*places.min(axis=0), *places.max(axis=0)], atol=1e-7)
