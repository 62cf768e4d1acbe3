"""Makers of relief textures: each puts the surface where it was."""

from __future__ import annotations

import numpy as np
import pytest

import ibrpipe
from ibrpipe.errors import RendererError, ShapeError, ValueRangeError
from ibrpipe.modelling.relief_textures import (
    Plane,
    asset_from_reliefs,
    box_from_mesh,
    relief_from_images,
    relief_from_layers,
    relief_from_mesh,
    reliefs_from_range,
)
from ibrpipe.types import Mesh
from ibrpipe.types.layers import layers_of_relief


def ball(n=48, radius=1.0):
    """A closed sphere of triangles."""
    theta, phi = np.linspace(0, np.pi, n), np.linspace(0, 2 * np.pi, 2 * n)
    t, p = np.meshgrid(theta, phi, indexing="ij")
    points = radius * np.stack([np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)], -1)
    i = np.arange(t.size).reshape(t.shape)
    a, b, c, d = i[:-1, :-1].ravel(), i[:-1, 1:].ravel(), i[1:, :-1].ravel(), i[1:, 1:].ravel()
    return Mesh(
        points.reshape(-1, 3), np.concatenate([np.stack([a, c, b], 1), np.stack([b, c, d], 1)]).astype(np.int32)
    )


def positions(relief):
    """World points of the opaque texels."""
    row, column = np.nonzero(np.isfinite(relief.height))
    f = relief.frame
    d = relief.height[row, column].astype(float)
    return f.origin + (column + 0.5)[:, None] * f.a + (row + 0.5)[:, None] * f.b + d[:, None] * f.f


def test_images_lie_round_the_origin():
    height = np.arange(6.0).reshape(2, 3)
    relief = relief_from_images(height, size=(3.0, 1.0))
    points = positions(relief)
    np.testing.assert_allclose(points[0], (-1.0, 0.25, 0.0))
    np.testing.assert_allclose(points[-1], (1.0, -0.25, 5.0))
    with pytest.raises(ValueRangeError, match="size is 0"):
        relief_from_images(height, size=(0.0, 1.0))


@pytest.mark.parametrize("side", ["+x", "-x", "+y", "-y", "+z", "-z"])
def test_a_side_of_a_ball_lies_on_the_ball(side):
    relief = relief_from_mesh(ball(), side, 40)
    points = positions(relief)
    np.testing.assert_allclose(np.linalg.norm(points, axis=1), 1.0, atol=0.01)
    axis = "xyz".index(side[1])
    assert (points[:, axis] * (1 if side[0] == "+" else -1) > 0).all()
    assert np.nanmax(relief.height) <= 1e-5
    assert np.isfinite(relief.height).mean() == pytest.approx(np.pi / 4, abs=0.03)


@pytest.mark.parametrize("renderer", ["prewarp", "ldi"])
def test_a_box_is_seen_from_every_region(renderer):
    asset = asset_from_reliefs(box_from_mesh(ball(), 48), "abcdef", "ball")
    prepared = ibrpipe.prepare(asset, renderer)
    ways = [np.array(w) for w in np.ndindex(3, 3, 3) if w != (1, 1, 1)]
    for way in ways:
        eye = 4.0 * (way - 1.0) + (0.01, 0.02, 0.03)
        camera = ibrpipe.Camera.look_at(eye, (0, 0, 0), (0.1, 0.2, 1), 60.0, 64, 64)
        frame = ibrpipe.render(prepared, camera, renderer)
        y, x = np.mgrid[:64, :64] + 0.5
        rays = np.stack([x, y, np.ones_like(x)], -1) @ camera.world_from_pixel.T
        b, c = rays @ eye, eye @ eye - 1
        square = b * b - (rays**2).sum(-1) * c
        want = np.where(square > 0, (-b - np.sqrt(np.maximum(square, 0))) / (rays**2).sum(-1), np.inf)
        assert (np.isfinite(frame.depth) != np.isfinite(want)).mean() < 0.03
        both = np.isfinite(frame.depth) & np.isfinite(want)
        error = np.abs(frame.depth[both] - want[both])
        assert np.median(error) < 0.01
        assert np.quantile(error, 0.95) < 0.08  # at 64 pixels many lie on the limb
        if renderer == "prewarp":
            assert frame.stats["quads"] == np.abs(way - 1).sum() <= 3
            assert ((frame.alpha > 0) == np.isfinite(frame.depth)).all()


@pytest.mark.parametrize("method", ["two-pass", "pipelined"])
def test_merged_quads_show_what_the_single_textures_show(method):
    prepared = ibrpipe.prepare(asset_from_reliefs(box_from_mesh(ball(), 48), "abcdef", "ball"), "prewarp")
    camera = ibrpipe.Camera.look_at((3.0, -2.5, 2.0), (0, 0, 0), (0, 0, 1), 40.0, 96, 96)
    merged = ibrpipe.render(prepared, camera, "prewarp", method=method)
    each = ibrpipe.render(prepared, camera, "prewarp", method=method, quads="each")
    assert merged.stats["quads"] == 3
    both = np.isfinite(merged.depth) & np.isfinite(each.depth)
    assert (np.isfinite(merged.depth) != np.isfinite(each.depth)).mean() < 0.01
    assert np.median(np.abs(merged.depth[both] - each.depth[both])) < 0.01
    assert np.median(np.abs(merged.color[both] - each.color[both])) < 0.02
    inside = ibrpipe.Camera.look_at((0.9, 0.9, 0.9), (0, 0, 0), (0, 0, 1), 40.0, 16, 16)
    assert ibrpipe.render(prepared, inside, "prewarp", fallback="never").stats["quads"] > 3


def test_quads_are_merged_only_for_the_faces_of_one_box():
    side = relief_from_mesh(ball(), "+z", 24)
    assert ibrpipe.prepare([side], "prewarp").data.box is None
    assert ibrpipe.prepare([side, relief_from_mesh(ball(), "-z", 24)], "prewarp").data.box is None
    assert ibrpipe.prepare([side, relief_from_mesh(ball(), "-x", 24)], "prewarp").data.box is not None
    frame, texel = side.frame, np.linalg.norm(side.frame.a)
    aside = frame.origin + 0.5 * frame.a / texel
    moved = ibrpipe.ParallelFrame(aside, frame.b, frame.f * texel, frame.a / texel)
    assert ibrpipe.prepare([side, ibrpipe.ReliefTexture(moved, side.color, side.height)], "prewarp").data.box is None


def test_layers_and_back():
    relief = relief_from_mesh(ball(), "+z", 24)
    again = relief_from_layers(layers_of_relief(relief))
    np.testing.assert_array_equal(again.height, relief.height)
    np.testing.assert_array_equal(again.color[np.isfinite(relief.height)], relief.color[np.isfinite(relief.height)])
    layers = layers_of_relief(relief)
    inner = np.linalg.norm(positions(relief)[:, :2], axis=1) < 0.7
    assert (np.sum(layers.normal * positions(relief), axis=1)[inner] > 0.97).all()


def scans():
    """Depth images of a ball in front of a wall z = -2, from two places."""
    found = []
    for eye in ((0.3, 0.0, 6.0), (-2.0, 1.0, 5.0)):
        camera = ibrpipe.Camera.look_at(eye, (0, 0, -1), (0, 1, 0), 50.0, 160, 120)
        y, x = np.mgrid[:120, :160] + 0.5
        rays = np.stack([x, y, np.ones_like(x)], -1) @ camera.world_from_pixel.T
        center = camera.center
        a, b, c = (rays**2).sum(-1), rays @ center, center @ center - 1
        square = b * b - a * c
        sphere = np.where(square > 0, (-b - np.sqrt(np.maximum(square, 0))) / a, np.inf)
        wall = (-2.0 - center[2]) / rays[..., 2]
        color = np.where((sphere < wall)[..., None], (0.8, 0.1, 0.1), (0.1, 0.1, 0.8))
        found.append(ibrpipe.DepthImage(camera, color, np.minimum(sphere, wall)))
    return found


def test_range_data_lands_on_the_planes():
    wall = Plane((-2.0, -1.5, -2.2), (0.0, 3.0, 0.0), (4.0, 0.0, 0.0), 60, 80, -3.0, 0.5)
    front = Plane((-1.0, 1.0, 1.5), (2.0, 0.0, 0.0), (0.0, -2.0, 0.0), 64, 64, 0.0, 2.0)
    _, relief = reliefs_from_range(scans(), [wall, front])
    points, color = positions(relief), relief.color[np.isfinite(relief.height)]
    near = np.linalg.norm(points, axis=1)
    assert np.isfinite(relief.height).mean() > 0.6
    assert np.quantile(np.abs(near - 1.0), 0.95) < 0.01
    assert (color[:, 0] > 0.7).mean() > 0.97
    with pytest.raises(ShapeError, match="no surface"):
        reliefs_from_range([], [front])
    with pytest.raises(ValueRangeError, match="two edges"):
        reliefs_from_range(scans(), [Plane((0, 0, 0), (1, 0, 0), (2, 0, 0), 4, 4)])


def test_perspective_layers_are_no_relief():
    camera = ibrpipe.Camera.look_at((0, 0, 5), (0, 0, 0), (0, 1, 0), 45, 4, 3)
    layers = ibrpipe.LayeredDepthImage(
        camera, np.zeros((3, 5), np.int64), np.empty(0), np.empty((0, 3)), np.empty((0, 3))
    )
    with pytest.raises(RendererError, match="parallel frame"):
        relief_from_layers(layers)
