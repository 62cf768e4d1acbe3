"""Captured things in a scene: where they stand, what hides them, what is refused."""

from __future__ import annotations

import numpy as np
import pytest

import ibrpipe
from ibrpipe.errors import RendererError
from ibrpipe.renderers.hierarchical.captured import captured_things
from ibrpipe.synthetic.instanced.pieces import painted_box, placed, turned
from ibrpipe.types import Camera, Instances, Part, ReliefTexture, Scene
from ibrpipe.types.camera import ParallelFrame


def bump(size=24):
    """A relief texture 2 wide around the origin, heights along +z."""
    y, x = np.mgrid[0:size, 0:size] / size
    height = (0.3 * np.sin(3 * x) * np.cos(2 * y)).astype(np.float32)
    color = np.stack([x, y, 0.5 + 0 * x], axis=-1).astype(np.float32)
    step = 2.0 / size
    frame = ParallelFrame(
        np.array([-1, 1, 0.0]), np.array([step, 0, 0]), np.array([0, -step, 0]), np.array([0, 0, 1.0])
    )
    return ReliefTexture(frame, color, height)


def camera(width=60, height=45):
    return Camera.look_at((0.5, -2, 5), (0, 0, 0), fov_y_deg=40, width=width, height=height)


def scene(matrices, *meshes):
    return Scene(
        [Part("bump", sources=(bump(),)), Part("root", meshes, children=(Instances("bump", matrices),))], "root"
    )


def test_a_captured_thing_alone_is_what_its_own_renderer_draws():
    found = ibrpipe.render(scene(np.eye(4)), camera(), "hierarchical")
    alone = ibrpipe.render(bump(), camera(), "ldi", samples="adaptive")
    shown = alone.alpha > 0
    assert shown.sum() > 300
    np.testing.assert_allclose(found.color, alone.color, atol=1e-5)
    np.testing.assert_allclose(found.alpha, alone.alpha, atol=1e-6)
    solid = np.isfinite(alone.depth) & (alone.alpha == 1)
    np.testing.assert_allclose(found.depth[solid], alone.depth[solid], rtol=1e-5)
    assert found.stats["captured"] == 1


def test_a_copy_is_turned_scaled_and_moved_as_points_are():
    matrix = placed((0.3, 0.2, -1.0), turned((1, 2, 3), 0.4), 1.7)
    found = ibrpipe.render(scene(matrix), camera(), "hierarchical")
    shown = found.alpha == 1
    assert shown.sum() > 300
    world = camera().center + camera().pixel_rays() * found.depth[..., None]
    local = (world[shown] - matrix[:3, 3]) @ np.linalg.inv(matrix[:3, :3]).T
    x, y = (local[:, 0] + 1) / 2 - 0.5 / 24, (1 - local[:, 1]) / 2 - 0.5 / 24
    inside = (np.minimum(x, y) > 0) & (np.maximum(x, y) < 23 / 24)
    assert inside.mean() > 0.85
    np.testing.assert_allclose(local[inside, 2], (0.3 * np.sin(3 * x) * np.cos(2 * y))[inside], atol=3e-3)
    np.testing.assert_allclose(found.color[shown][inside, 0], x[inside], atol=0.03)


def test_boxes_stand_before_and_behind_it_by_depth():
    before = painted_box((-0.6, -0.5, 0.8), (0.0, 0.5, 0.9), (1, 0, 0))
    behind = painted_box((-3, -3, -1.2), (3, 3, -1.0), (0, 1, 0))
    found = ibrpipe.render(scene(np.eye(4), before, behind), camera(), "hierarchical")
    boxes = ibrpipe.render(Scene([Part("root", (before, behind))], "root"), camera(), "hierarchical")
    alone = ibrpipe.render(bump(), camera(), "ldi")
    whole = (boxes.alpha == 1) & (alone.alpha == 1)
    near = whole & (boxes.depth < alone.depth - 0.1)
    far = whole & (boxes.depth > alone.depth + 0.1)
    edges = np.zeros_like(whole)
    edges[2:-2, 2:-2] = True
    for shift in ((1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (-1, -1), (1, -1), (-1, 1)):
        edges &= np.roll(near, shift, (0, 1)) == near
        edges &= np.roll(far, shift, (0, 1)) == far
    assert min((near & edges).sum(), (far & edges).sum()) > 30
    np.testing.assert_allclose(found.color[near & edges], boxes.color[near & edges], atol=0.01)
    np.testing.assert_allclose(found.color[far & edges], alone.color[far & edges], atol=0.01)


def test_copies_out_of_view_are_left_out_and_those_of_all_levels_are_found():
    pair = np.stack([placed((0, 0, 0)), placed((500, 0, 0))])
    row = Part("row", children=(Instances("bump", pair),))
    lifted = Scene(
        [Part("bump", sources=(bump(),)), row, Part("root", children=(Instances("row", placed((0, 0, -1))),))], "root"
    )
    (thing,) = captured_things(lifted)
    np.testing.assert_array_equal(thing.matrices[:, :3, 3], [[0, 0, -1], [500, 0, -1]])
    assert ibrpipe.render(lifted, camera(), "hierarchical").stats["captured"] == 1


@pytest.mark.parametrize("scale", [np.array([1.0, 1, 2]), np.array([-1.0, 1, 1]), np.array([1.0, 1, 0])])
def test_what_was_photographed_is_not_stretched_mirrored_or_flattened(scale):
    with pytest.raises(RendererError, match="copy 1 of 'bump' is mirrored, sheared, stretched or flattened, and holds"):
        ibrpipe.prepare(scene(np.stack([np.eye(4), placed((0, 0, 0), None, scale)])), "hierarchical")
