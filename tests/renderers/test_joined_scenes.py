"""Scenes drawn by renderers that know none: captured things by them, meshes by `hierarchical`, joined by depth."""

from __future__ import annotations

import numpy as np
import pytest

import ibrpipe
from ibrpipe.errors import RendererError
from ibrpipe.modelling.relief_textures import asset_from_reliefs
from ibrpipe.synthetic.instanced.pieces import painted_box, placed, turned
from ibrpipe.types import Camera, Instances, Mesh, ParallelFrame, Part, Scene
from ibrpipe.types.relief_mesh import ReliefMesh


def bump(size=24, height=None):
    """A relief texture 2 wide around the origin, heights along +z."""
    y, x = np.mgrid[0:size, 0:size] / size
    height = 0.3 * np.sin(3 * x) * np.cos(2 * y) if height is None else np.full((size, size), height)
    color = np.stack([x, y, 0.5 + 0 * x], axis=-1)
    step = 2.0 / size
    frame = ParallelFrame((-1, 1, 0), (step, 0, 0), (0, -step, 0), (0, 0, 1))
    return ibrpipe.ReliefTexture(frame, color, height)


def camera(width=60, height=45):
    return Camera.look_at((0.5, -2, 5), (0, 0, 0), fov_y_deg=40, width=width, height=height)


def scene(matrices, *meshes, source=None):
    parts = [Part("thing", sources=(source or bump(),)), Part("root", meshes, children=(Instances("thing", matrices),))]
    return Scene(parts, "root")


@pytest.mark.parametrize("renderer", ["ldi", "prewarp", "relief", "epipolar", "splat"])
def test_one_thing_is_what_the_renderer_draws_alone(renderer):
    joined = ibrpipe.render(scene(np.eye(4)), camera(), renderer)
    alone = ibrpipe.render(bump(), camera(), renderer)
    np.testing.assert_allclose(joined.depth, alone.depth, rtol=1e-6)
    np.testing.assert_allclose(joined.color, alone.color, atol=1e-6)
    only = ibrpipe.render(scene(np.eye(4)), camera(), renderer, outputs=("depth",))
    assert only.color is None
    np.testing.assert_array_equal(only.depth, joined.depth)


def test_copies_and_meshes_are_joined_by_depth():
    matrices = np.stack([placed((0, 0, 0), np.eye(3), 1.0), placed((0.6, 0, 1.0), turned((0, 1, 0), 0.5), 0.5)])
    box = painted_box((-1.2, -0.2, -0.4), (-0.6, 0.2, 0.8), (0.2, 0.2, 0.9))
    prepared = ibrpipe.prepare(scene(matrices, box), "prewarp")
    whole = ibrpipe.render(prepared, camera(), "prewarp", outputs=("depth", "alpha"), fallback="never")
    frames = [ibrpipe.render(scene(matrix), camera(), "prewarp", fallback="never").depth for matrix in matrices]
    meshes = Scene([Part("root", (box,))], "root")
    shown = ibrpipe.render(meshes, camera(), "hierarchical")
    frames.append(shown.depth)
    nearest = np.min(frames, axis=0)
    solid = (whole.alpha == 1) & ((shown.alpha == 0) | (shown.alpha == 1))
    assert [int((np.isclose(whole.depth, each) & solid).sum()) > 40 for each in frames] == [True] * 3
    np.testing.assert_allclose(whole.depth[solid], nearest[solid], rtol=1e-4)
    assert whole.stats["frames"] == 3
    assert prepared.bytes > 0


def test_a_lamp_stands_in_the_world_and_not_in_the_part():
    quad = Mesh(np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], float), np.array([[0, 1, 2], [0, 2, 3]]))
    uv = np.array([[[0, 1], [1, 1], [1, 0]], [[0, 1], [1, 0], [0, 0]]], float)
    source = ReliefMesh(quad, uv, np.full((4, 4), 1.0), 0.1)
    matrix = placed((0.3, 0.1, 0.5), turned((0, 0, 1), 1.0), 1.5)
    moved = source.with_vertices(quad.vertices @ matrix[:3, :3].T + matrix[:3, 3])
    for light in ((0.5, 1.0, 2.0), (1.0, 0.5, 1.0, 0.0)):
        options = {"light": light, "specular": 0.5}
        joined = ibrpipe.render(scene(matrix, source=source), camera(), "relief", **options)
        alone = ibrpipe.render(moved, camera(), "relief", **options)
        both = np.isfinite(joined.depth) & np.isfinite(alone.depth)
        assert both.sum() > 500
        np.testing.assert_allclose(joined.color[both], alone.color[both], atol=2e-3)
        assert np.ptp(joined.color[both]) > 0.05


def test_what_a_renderer_does_not_take_another_one_draws():
    depth = ibrpipe.DepthImage(Camera.look_at((0, 0, 4), (0, 0, 0), (0, 1, 0), 30, 16, 16), np.ones((16, 16, 3)),
                               np.full((16, 16), 3.0))  # fmt: skip
    found = ibrpipe.render(scene(np.eye(4), source=depth), camera(), "prewarp")
    np.testing.assert_allclose(found.depth, ibrpipe.render(depth, camera(), "ldi").depth, rtol=1e-6)


def test_nothing_in_view_is_an_empty_frame_and_meshes_alone_are_refused():
    away = Camera.look_at((0, 0, 5), (0, 0, 9), (0, 1, 0), 40, 8, 6)
    frame = ibrpipe.render(scene(np.eye(4)), away, "ldi")
    assert np.isinf(frame.depth).all()
    assert (frame.alpha == 0).all()
    assert frame.color.shape == (6, 8, 3)
    with pytest.raises(RendererError, match="Scene of meshes alone"):
        ibrpipe.render(Scene([Part("a", (painted_box((0, 0, 0), (1, 1, 1), (1, 1, 1)),))], "a"), away, "ldi")
    with pytest.raises(RendererError, match="no first picture"):
        next(ibrpipe.render_progressive(scene(np.eye(4)), away))


@pytest.mark.parametrize("renderer", ["ldi", "prewarp", "relief", "epipolar", "splat"])
@pytest.mark.parametrize("layered", [False, True])
def test_a_level_surface_at_depth_0_is_met(renderer, layered):
    source = asset_from_reliefs([bump(height=0.0)], ["a"], "test") if layered else bump(height=0.0)
    found = ibrpipe.render(source, camera(), renderer).depth
    z = camera().center[2] + camera().pixel_rays()[..., 2] * found
    there = np.isfinite(found)
    assert there.sum() > 200
    np.testing.assert_allclose(z[there], 0.0, atol=0.03 if renderer == "splat" else 1e-5)  # splats lie at texel centres


def test_progressive_frames_end_with_the_whole_one():
    frames = list(ibrpipe.render_progressive(bump(), camera(), ("color", "alpha"), samples=4))
    assert len(frames) == 2
    want = ibrpipe.render(bump(), camera(), "ldi", ("color", "alpha"), samples=4)
    np.testing.assert_array_equal(frames[1].color, want.color)
    assert set(np.unique(frames[0].alpha)) == {0, 1}
    assert frames[0].depth is None
    with pytest.raises(RendererError, match="no option 'sample'"):
        next(ibrpipe.render_progressive(bump(), camera(), sample=4))
