"""Charts of layered images: what hangs together, where it lies, and how it is wound."""

from __future__ import annotations

import numpy as np
import pytest
from page_assets import ball_layers, make_asset, seen_from_a_point

from ibrpipe.core.directions import spread_directions
from ibrpipe.core.reflection.directions import pad
from ibrpipe.export.surface.atlas import PADDING, Atlas, color_picture
from ibrpipe.export.surface.charts import charts_of
from ibrpipe.export.surface.colors import mean_colors, table_lights
from ibrpipe.export.surface.decimate import decimate
from ibrpipe.export.surface.placement import gltf_from_world, metres_of
from ibrpipe.io.paths import up_of
from ibrpipe.types import Camera, LayeredDepthImage, ParallelFrame, Texture
from ibrpipe.types.bounds import sample_positions
from ibrpipe.types.layers import offsets_of, pitch_of


def all_of(layers):
    return charts_of(layers, np.ones(len(layers.depth), bool))


@pytest.mark.parametrize("layers", [ball_layers(), ball_layers(back=True), seen_from_a_point()])
def test_every_sample_is_a_vertex_of_one_chart_at_its_place(layers):
    charts = all_of(layers)
    assert sorted(np.concatenate([each.samples for each in charts])) == list(range(len(layers.depth)))
    places = sample_positions(layers)
    for chart in charts:
        held = chart.vertex_samples >= 0
        assert sorted(chart.vertex_samples[held]) == sorted(chart.samples)
        np.testing.assert_allclose(chart.vertices[held], places[chart.vertex_samples[held]], atol=1e-5)
        np.testing.assert_allclose(chart.place(chart.vertices), chart.texels, atol=1e-4)
        left, top, columns, rows = chart.box
        assert (chart.texels >= (left, top)).all()
        assert (chart.texels < (left + columns, top + rows)).all()


def test_a_ball_before_a_wall_is_two_charts():
    layers = ball_layers()
    ball, wall = sorted(all_of(layers), key=lambda chart: chart.vertices[:, 2].mean(), reverse=True)
    assert len(wall.samples) == 48 * 48
    np.testing.assert_allclose(np.linalg.norm(ball.vertices[ball.vertex_samples >= 0], axis=1), 1.0, atol=1e-6)


@pytest.mark.parametrize("layers", [ball_layers(), ball_layers(back=True), seen_from_a_point()])
def test_triangles_face_the_side_that_layers_are_seen_from(layers):
    for chart in all_of(layers):
        a, b, c = (chart.vertices[chart.faces[:, k]] for k in range(3))
        normal = np.cross(b - a, c - a)
        toward = layers.frame.center - a if isinstance(layers.frame, Camera) else -layers.frame.f
        assert ((normal * toward).sum(axis=1) > 0).mean() > 0.99


def test_two_samples_of_one_texel_that_hang_together_are_told_apart():
    # a ramp that passes below itself: columns 0 to 7 there, back again one unit deeper, joined at the end
    frame = ParallelFrame((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1))
    depth = np.stack([np.full((4, 8), 1.0), np.where(np.arange(8) == 7, 1.5, 3.0) * np.ones((4, 1))], axis=-1)
    normal = np.full((64, 3), np.nan)
    layers = LayeredDepthImage(
        frame, offsets_of(np.full((4, 8), 2)), depth.ravel(), np.zeros((64, 3)), normal, np.ones(64, np.int32)
    )
    for chart in all_of(layers):
        assert len(np.unique(chart.places, axis=0)) == len(chart.places)


def test_charts_without_a_kept_sample_are_left_out():
    layers = ball_layers()
    near = sample_positions(layers)[:, 2] > -1.0
    (ball,) = charts_of(layers, near)
    assert set(ball.samples) == set(np.flatnonzero(near))


def test_texels_lie_apart_in_the_atlas_and_hold_the_samples_colours():
    layers = ball_layers()
    charts = all_of(layers)
    atlas = Atlas(charts)
    seen = [np.full(len(chart.samples), 255, np.uint8) for chart in charts]
    picture = color_picture(atlas, [layers.color[chart.samples] for chart in charts], seen)
    assert (picture[..., 3] == 255).sum() == len(layers.depth)
    marks, there = atlas.spread([np.full((len(chart.samples), 1), n + 1) for n, chart in enumerate(charts)])
    assert there.sum() == len(layers.depth)
    for number, chart in enumerate(charts):
        uv = atlas.coordinates(number, chart.places.astype(float)) * atlas.shape[::-1]
        column, row = np.floor(uv).astype(int).T
        np.testing.assert_allclose(uv % 1.0, 0.5)
        assert (marks[row, column, 0] == number + 1).all()
        assert column.min() >= PADDING
        assert row.min() >= PADDING


def test_specks_that_no_photo_sees_are_closed_and_larger_holes_stay():
    layers = ball_layers(wall=False)
    (ball,) = all_of(layers)
    atlas = Atlas([ball])
    place = ball.places - np.median(ball.places, axis=0).astype(int)
    hole = (np.abs(place - (8, 0)) <= 3).all(axis=1)
    shown = np.where(hole | (place == 0).all(axis=1), 0, 255).astype(np.uint8)
    alpha = color_picture(atlas, [layers.color[ball.samples]], [shown])[..., 3]
    assert (alpha == 255).sum() == len(layers.depth) - 25  # 7 x 7 loses its rim


def test_flat_surfaces_take_few_triangles_and_none_is_joined_at_tolerance_zero():
    layers = ball_layers()
    wall = max(all_of(layers), key=lambda chart: len(chart.samples))
    vertices, faces = decimate(wall.vertices, wall.faces, 1.0, pitch_of(layers))
    # of 2 x 49 x 49 triangles fewer than there are along the rim, 4 x 49: the inside is joined
    assert len(faces) < 0.05 * len(wall.faces) < 4 * 49 * 1.25
    np.testing.assert_allclose(vertices[:, 2], -1.2, atol=1e-6)
    corners = wall.vertices.min(axis=0), wall.vertices.max(axis=0)
    np.testing.assert_allclose([vertices.min(axis=0), vertices.max(axis=0)], corners, atol=0.5 * pitch_of(layers))
    assert decimate(wall.vertices, wall.faces, 0.0, pitch_of(layers))[1] is wall.faces


def test_mean_colours_are_between_those_of_the_views():
    texture = make_asset("gloss").textures[0]
    places = sample_positions(texture.layers)
    camera = Camera.look_at((0, 0, 4), (0, 0, 0), (0, 1, 0))
    one = mean_colors(texture, places, [camera])
    top = int(np.argmax(texture.layers.normal[:, 2]))
    reflection, normal = texture.component("reflection"), texture.layers.normal[top].astype(float)
    toward = camera.center - places[top]
    toward /= np.linalg.norm(toward)
    mirrored = (2 * (normal @ toward) * normal - toward)[None]
    grazing = (1 - normal @ toward) ** 5
    wanted = (1 - reflection.light.damping * grazing) * texture.layers.color[top]
    for k, f, table in zip(reflection.weights[top], reflection.light.reflectance, pad(reflection.light.tables)):
        wanted = wanted + k * (f + (1 - f) * grazing) * table_lights(table, mirrored)[0]
    np.testing.assert_allclose(one[top], np.minimum(wanted, 1.0), atol=1e-3)
    around = mean_colors(texture, places, [])
    assert (around >= 0).all()
    assert (around[top] > 0.7 * texture.layers.color[top]).all()
    plain = Texture(texture.layers)
    assert mean_colors(plain, places, [camera]) is plain.layers.color


def test_directions_are_evenly_spread():
    found = spread_directions(64)
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1.0)
    np.testing.assert_allclose(found.mean(axis=0), 0.0, atol=0.02)
    np.testing.assert_allclose(found.T @ found / 64, np.eye(3) / 3, atol=0.03)


def test_up_becomes_y_and_lengths_metres():
    turned = gltf_from_world(np.array([0.0, 0.0, 1.0]), 0.001, np.array([10.0, 0.0, 0.0]))
    np.testing.assert_allclose(turned @ [10, 0, 2000, 1], [0, 2, 0, 1], atol=1e-12)
    np.testing.assert_allclose(turned @ [1010, 0, 0, 1], [1, 0, 0, 1], atol=1e-12)
    assert np.linalg.det(turned[:3, :3]) > 0
    for up in ((0, 1, 0), (0, -1, 0), (1, 0, 0), (0.6, 0.0, 0.8)):
        turn = gltf_from_world(np.array(up, float), 1.0, np.zeros(3))[:3, :3]
        np.testing.assert_allclose(turn @ up, [0, 1, 0], atol=1e-12)
        np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(turn) == pytest.approx(1.0)
    assert [metres_of(each) for each in ("mm", "metres; x right", "Meter", "furlong", "")] == [0.001, 1, 1, None, None]


def test_photos_say_what_is_up_and_an_axis_near_it_is_taken():
    level = [Camera.look_at(eye, (0, 0, 0), (0, 0, 1)) for eye in ((5, 0, 1), (0, 5, 1), (-5, 0, 1))]
    np.testing.assert_array_equal(up_of(level, 20), [0, 0, 1])
    np.testing.assert_array_equal(up_of([], 20), [0, 0, 1])
    leaning = [Camera.look_at(eye, (0, 0, 0), (0, 1, 1)) for eye in ((5, 0, 0), (-5, 0, 0))]
    np.testing.assert_allclose(up_of(leaning, 20), np.sqrt([0, 0.5, 0.5]), atol=1e-9)
