"""Through which rectangle a view ray passes, by hand on a box."""

from __future__ import annotations

import numpy as np

from ibrpipe.modelling.rectangles import box_faces, passed

FACES = box_faces(np.zeros(3), np.eye(3), np.ones(3), 0.05)
NAMES = [face.name for face in FACES]


def name_of(point: tuple[float, float, float], toward: tuple[float, float, float]) -> str:
    way = np.array([toward]) / np.linalg.norm(toward)
    return NAMES[int(passed(FACES, np.array([point]), way)[0])]


def test_straight_out() -> None:
    for face in FACES:
        assert name_of((0.1, 0.2, -0.1), tuple(-face.f)) == face.name


def test_a_slanted_ray_leaves_by_the_side_that_it_meets_first() -> None:
    # more along x than along z, yet so near the top that it goes out there: the surface faces neither
    assert name_of((0.0, 0.0, 0.9), (1.0, 0.0, 0.8)) == "+z"
    assert name_of((0.0, 0.0, -0.9), (1.0, 0.0, 0.8)) == "+x"  # here there is room to reach the side


def test_equal_to_the_exit_of_the_box_for_random_rays() -> None:
    rng = np.random.default_rng(3)
    points, toward = rng.uniform(-0.9, 0.9, (2000, 3)), rng.normal(size=(2000, 3))
    toward /= np.linalg.norm(toward, axis=1, keepdims=True)
    reach = (np.where(toward > 0, 1.05, -1.05) - points) / toward  # one texel of margin
    axis = reach.argmin(axis=1)
    wanted = [("+" if toward[i, a] > 0 else "-") + "xyz"[a] for i, a in enumerate(axis)]
    found = [NAMES[i] for i in passed(FACES, points, toward)]
    square = np.abs(toward[np.arange(2000), axis]) > 0.03  # shallower rays are never asked for
    assert square.sum() > 1900
    assert [f for f, s in zip(found, square, strict=True) if s] == [w for w, s in zip(wanted, square, strict=True) if s]


def test_a_ray_that_passes_none_goes_to_the_squarest() -> None:
    side = [face for face in FACES if face.name in ("+x", "+z")]
    assert side[int(passed(side, np.array([[0.0, 0.0, 0.0]]), np.array([[0.1, -0.99, 0.05]]))[0])].name == "+x"
