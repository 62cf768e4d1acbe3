"""Back-projection of diffuse colours: the training photos come nearer, highlights and unseen samples move nothing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ibrpipe.core.color import srgb_decode, srgb_encode
from ibrpipe.modelling.diffuse_refinement import sample_points, sharpen
from ibrpipe.modelling.layers import LayersConfig, build_layers
from ibrpipe.modelling.plan_file import TexturePlan
from ibrpipe.modelling.rectangles import box_faces

MEDIAN = 0


@pytest.fixture(scope="module")
def wall(measured):
    """The matt wall's mesh and photos, rectangles and layers of its box."""
    lambert = measured("lambert")
    vertices = lambert.caster.mesh.vertices
    half = np.ptp(vertices, axis=0) / 2
    faces = box_faces(vertices.min(axis=0) + half, np.eye(3), half, 0.08)
    plans = [TexturePlan(face, 60.0, 8) for face in faces]
    exact = LayersConfig(depth_bits=32, color_bits=16)
    built = [build_layers(i, plans, lambert.caster, lambert.photos, exact)[0] for i in range(len(plans))]
    return lambert, faces, built


def test_a_round_brings_the_training_photos_nearer(wall):
    lambert, faces, layers = wall
    wanted = [True] * len(layers)
    sharp, psnr = sharpen(faces, layers, wanted, lambert.caster, lambert.photos, 1, MEDIAN)
    assert len(psnr) == 2
    assert psnr[1] > psnr[0] + 0.5
    again, _ = sharpen(faces, layers, wanted, lambert.caster, lambert.photos, 1, MEDIAN)
    for one, other, before in zip(sharp, again, layers):
        np.testing.assert_array_equal(one.color, other.color)
        np.testing.assert_array_equal(one.depth, before.depth)
        unseen = before.observers == 0
        np.testing.assert_array_equal(one.color[unseen], before.color[unseen])
        assert one.color.min(initial=0) >= 0


def test_colours_that_are_too_dark_by_a_known_amount_are_mended(wall):
    lambert, faces, layers = wall
    start, _ = sharpen(faces, layers, [True] * len(layers), lambert.caster, lambert.photos, 3, MEDIAN)
    dark = [replace(one, color=srgb_decode(np.maximum(srgb_encode(one.color) - 0.1, 0))) for one in start]
    mended, psnr = sharpen(faces, dark, [True] * len(layers), lambert.caster, lambert.photos, 1, MEDIAN)
    assert psnr[0] == pytest.approx(20.0, abs=1.0)  # 0.1 of the display code is 20 dB
    got, want = (np.concatenate([srgb_encode(one.color) for one in part]) for part in (mended, start))
    seen = (np.concatenate([one.observers for one in mended]) >= 4) & (want.min(axis=1) > 0.1)
    assert seen.sum() > 1000
    assert np.median(np.abs(got[seen] - want[seen])) < 0.01


def test_only_what_is_wanted_changes(wall):
    lambert, faces, layers = wall
    wanted = [index == 3 for index in range(len(layers))]
    sharp, _ = sharpen(faces, layers, wanted, lambert.caster, lambert.photos, 1, MEDIAN)
    assert [one is other for one, other in zip(sharp, layers)] == [not want for want in wanted]
    same, psnr = sharpen(faces, layers, [False] * len(layers), lambert.caster, lambert.photos, 1, MEDIAN)
    assert psnr == []
    assert all(one is other for one, other in zip(same, layers))


def test_points_of_samples_lie_on_the_mesh(wall):
    lambert, faces, layers = wall
    points = sample_points(faces[3], layers[3])
    eye = np.array([0.3, -9.0, 0.2])
    hits = lambert.caster.cast(eye, points - eye)
    assert len(points) == len(layers[3].depth) > 100
    assert np.median(np.abs(hits.t - 1)) < 1e-5
