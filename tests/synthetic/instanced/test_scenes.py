"""Generated scenes of copies: their statistics, their repeatability, their cameras."""

from __future__ import annotations

import numpy as np
import pytest

from ibrpipe.errors import ValueRangeError
from ibrpipe.synthetic.instanced.city import city
from ibrpipe.synthetic.instanced.forest import VIEWS, forest, forest_cameras
from ibrpipe.synthetic.instanced.solids import painted_ball, solids
from ibrpipe.synthetic.instanced.trees import SPECIES


@pytest.mark.parametrize("kind", list(SPECIES))
def test_a_tree_has_five_levels_of_one_part_each(kind):
    scene = forest(3, species=[kind])
    assert scene.sub_objects[f"{kind}-tree"] == 1814
    assert scene.polygons[f"{kind}-tree"] == 29872
    assert len(scene.parts) == 6
    bounds = scene.bounds[f"{kind}-tree"]
    assert 5 < bounds.high[2] < 12


def test_a_forest_repeats_and_its_seed_changes_it():
    one, same, other = forest(50, 5), forest(50, 5), forest(50, 6)
    for name in one.parts:
        for a, b in zip(one.parts[name].children, same.parts[name].children):
            np.testing.assert_array_equal(a.matrices, b.matrices)
    assert not np.array_equal(
        one.parts["maple-twig"].children[0].matrices, other.parts["maple-twig"].children[0].matrices
    )
    assert sum(len(each) for each in one.parts["forest"].children) == 50
    assert one.polygons["forest"] == 50 * 29872 + 2


def test_trees_stand_apart_on_the_ground():
    scene = forest(100)
    places = np.concatenate([each.matrices[:, :3, 3] for each in scene.parts["forest"].children])
    assert (places[:, 2] == 0).all()
    apart = np.linalg.norm(places[:, None] - places[None], axis=-1) + 99 * np.eye(100)
    assert apart.min() > 1.0


def test_cameras_see_the_forest():
    cameras = forest_cameras(100, 64, 48)
    assert tuple(cameras) == VIEWS
    pixel = cameras["far"].pixel_from_world @ (0, 0, 0, 1)
    assert 0 < pixel[0] / pixel[2] < 64
    assert 0 < pixel[1] / pixel[2] < 48
    assert cameras["near"].center[2] == pytest.approx(1.8)


def test_a_city_is_made_of_few_parts():
    scene = city(9)
    assert scene.polygons["city"] > 10**6
    assert len(scene.parts) == 7
    assert scene.bounds["block"].high[2] < 60
    with pytest.raises(ValueRangeError, match="at least 1"):
        city(0)
    with pytest.raises(ValueRangeError, match="at least 1"):
        forest(0)


def test_solids_are_closed_and_outward():
    volume = 0.0
    for painted in (painted_ball(1.0, (1, 1, 1), rows=48), *solids().parts["wall"].meshes):
        a, b, c = (painted.mesh.vertices[painted.mesh.faces[:, n]] for n in range(3))
        volume = np.einsum("ni,ni->", a, np.cross(b, c)) / 6
        assert volume > 0
    assert volume == pytest.approx(4 * 4 * 0.3)


@pytest.mark.parametrize("trees", [1025, 2000, 2304])
def test_large_forests_are_cells_and_groves_of_few_patterns(trees):
    scene = forest(trees)
    assert scene.polygons["forest"] == trees * 29872 + 2
    assert {name.partition("-")[0] for name in scene.parts} == {"maple", "oak", "cell", "grove", "forest"}
    assert sum(len(each) for each in scene.parts["grove-0"].children) == 16
    assert len(scene.parts["forest"].children) <= 9
    for name in ("cell-2", "grove-1"):
        same, other = forest(5000).parts[name].children, forest(5000, 6).parts[name].children
        for a, b in zip(scene.parts[name].children, same):
            np.testing.assert_array_equal(a.matrices, b.matrices)
        assert any(len(a) != len(b) or (a.matrices != b.matrices).any() for a, b in zip(same, other))


def test_trees_of_cells_stand_as_far_apart_as_single_ones():
    scene = forest(1100)
    places, waiting = [], [("forest", np.eye(4))]
    while waiting:
        name, pose = waiting.pop()
        if name.endswith("-tree"):
            places.append(pose[:3, 3])
            continue
        waiting += [(each.part, pose @ matrix) for each in scene.parts[name].children for matrix in each.matrices]
    found = np.array(places)
    assert len(found) == 1100
    cells = np.floor(found[:, :2] / 7.0 + 17).astype(int)
    assert len(np.unique(cells, axis=0)) == 1100
    assert np.abs(found[:, :2]).max() < 17 * 7.0
