"""Support rectangles around the built-in scenes: the box holds the mesh."""

from __future__ import annotations

import numpy as np
import pytest

from ibrpipe.modelling.rectangles import bounding_box
from ibrpipe.synthetic.scene import joined_mesh
from ibrpipe.synthetic.scenes import make_scene, scene_names
from ibrpipe.synthetic.surfaces import tilt
from ibrpipe.types import Mesh


@pytest.mark.parametrize("detail", [0.35, 1.0])
@pytest.mark.parametrize("name", scene_names())
def test_the_box_holds_the_mesh(name: str, detail: float) -> None:
    mesh, _ = joined_mesh(make_scene(name, detail).parts)
    center, axes, half, _ = bounding_box(mesh)
    reach = np.abs((mesh.vertices - center) @ axes.T).max(axis=0)
    np.testing.assert_array_less(reach, half * (1 + 1e-5) + 1e-9)
    assert np.prod(2 * half) <= np.prod(np.ptp(mesh.vertices, axis=0)) * (1 + 1e-9)


def test_a_turned_block_gets_a_turned_box() -> None:
    turn = tilt("z", 31) @ tilt("x", 17)
    corners = np.stack(np.meshgrid((-3.0, 3.0), (-1.0, 1.0), (-0.5, 0.5)), axis=-1).reshape(-1, 3)
    faces = [(0, 1, 2), (1, 2, 3), (4, 5, 6), (5, 6, 7), (0, 2, 4), (1, 3, 5)]
    center, axes, half, _ = bounding_box(Mesh(corners @ turn.T + (5, 6, 7), np.array(faces)))
    np.testing.assert_allclose(center, (5, 6, 7), atol=1e-9)
    np.testing.assert_allclose(sorted(half), (0.5, 1.0, 3.0), atol=1e-6)
    np.testing.assert_allclose(np.linalg.det(axes), 1.0)
