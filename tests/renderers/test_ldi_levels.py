"""Pictures of layers whose samples fill their texels in part: what is behind is seen past them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import ibrpipe
from ibrpipe.renderers.ldi.progressive import render_progressive
from ibrpipe.types import LayeredDepthImage, ParallelFrame, ReliefTexture, Texture
from ibrpipe.types.layers import offsets_of, opaque

RED, GREEN, BLUE = np.eye(3, dtype=np.float32)


def frame_at(size, height=0.0):
    return ParallelFrame((0, size, height), (1, 0, 0), (0, -1, 0), (0, 0, -1))


def sheets(colors, depths, coverage, size=12, seen=None):
    """Level sheets of `size` texels seen from above, each of one colour and coverage."""
    count, n = len(colors), size * size
    observers = np.tile(np.ones(count, np.int32) if seen is None else np.array(seen, np.int32), n)
    return LayeredDepthImage(
        frame_at(size), offsets_of(np.full((size, size), count)), np.tile(np.float32(depths), n),
        np.tile(np.array(colors, np.float32), (n, 1)), np.tile(np.float32([0, 0, 1]), (count * n, 1)), observers,
        None if coverage is None else np.tile(np.float32(coverage), n),
    )  # fmt: skip


CAMERA = ibrpipe.Camera.look_at((6, 6, 40), (6, 6, 0), up=(0, 1, 0), fov_y_deg=8, width=9, height=7)


@pytest.mark.parametrize("search", ["patches", "quadtree"])
def test_colours_and_coverage_of_sheets_one_behind_another(search):
    source = sheets([RED, GREEN, BLUE], [1, 4, 8], [0.25, 0.5, 0.5])
    found = ibrpipe.render(source, CAMERA, search=search)
    weights = np.array([0.25, 0.75 * 0.5, 0.375 * 0.5])
    np.testing.assert_allclose(found.alpha, weights.sum(), atol=1e-5)
    np.testing.assert_allclose(found.color, np.broadcast_to(weights / weights.sum(), found.color.shape), atol=1e-5)
    np.testing.assert_allclose(found.depth, 44.0, atol=1e-3)  # more than half is covered from the second sheet on


def test_full_coverage_is_the_picture_without():
    hard = sheets([RED, GREEN], [1, 4], None)
    full = replace(hard, coverage=np.ones(len(hard.depth)))
    one, two = (ibrpipe.render(each, CAMERA) for each in (hard, full))
    for name in ("color", "alpha", "depth"):
        assert getattr(one, name).tobytes() == getattr(two, name).tobytes()


def test_one_surface_in_two_textures_covers_once():
    soft = sheets([RED], [1], [0.5])
    twice = [soft, replace(soft, depth=soft.depth + 0.2, color=np.tile(GREEN, (len(soft.depth), 1)))]
    np.testing.assert_allclose(ibrpipe.render(twice, CAMERA).alpha, 0.5, atol=1e-5)
    apart = [soft, replace(soft, depth=soft.depth + 2, color=np.tile(GREEN, (len(soft.depth), 1)))]
    np.testing.assert_allclose(ibrpipe.render(apart, CAMERA).alpha, 0.75, atol=1e-5)


def test_height_fields_are_seen_past_rims_and_hide_what_is_behind_them():
    soft = sheets([RED, GREEN], [1, 9], [0.25, 0.5])
    ground = ReliefTexture(frame_at(12), np.broadcast_to(BLUE, (12, 12, 3)), np.full((12, 12), 5.0))
    found = ibrpipe.render([soft, ground], CAMERA)
    np.testing.assert_allclose(found.alpha, 1.0, atol=1e-5)
    np.testing.assert_allclose(found.color, np.broadcast_to([0.25, 0, 0.75], found.color.shape), atol=1e-5)
    np.testing.assert_allclose(found.depth, 45.0, atol=1e-3)


def test_what_no_photo_saw_hides_what_is_behind():
    found = ibrpipe.render(sheets([RED, GREEN], [1, 4], [0.5, 1.0], seen=[0, 1]), CAMERA)
    assert not found.alpha.any()
    found = ibrpipe.render(sheets([RED, GREEN, BLUE], [1, 4, 8], [0.5, 1.0, 1.0], seen=[1, 0, 1]), CAMERA)
    np.testing.assert_allclose(found.alpha, 0.5, atol=1e-5)
    np.testing.assert_allclose(found.color, np.broadcast_to(RED, found.color.shape), atol=1e-5)


def test_depth_alone_is_that_of_the_whole_picture():
    source = sheets([RED, GREEN], [1, 4], [0.25, 1.0])
    np.testing.assert_array_equal(
        ibrpipe.render(source, CAMERA, outputs=("depth",)).depth, ibrpipe.render(source, CAMERA).depth
    )


@pytest.mark.parametrize("renderer", ["epipolar", "splat", "prewarp", "relief"])
def test_other_renderers_show_what_fills_half_of_its_texel(renderer):
    source = sheets([RED, GREEN], [1, 4], [0.25, 0.5])
    assert ibrpipe.render(source, CAMERA, renderer).color.tobytes() == (
        ibrpipe.render(opaque(source), CAMERA, renderer).color.tobytes()
    )
    middle = ibrpipe.render(source, CAMERA, renderer).color[3, 4]
    np.testing.assert_allclose(middle, GREEN, atol=1e-6)


def test_view_dependence_is_added_on_every_level():
    """Shared reflection, alike in all directions: every sheet shows it, and their mixture does."""
    from ibrpipe.types import ReflectedLight, Reflection

    light = ReflectedLight(np.full((1, 8, 8, 3), 0.5, np.float32), (0.5,), 0.0)
    plain = sheets([RED, GREEN], [1, 9], [0.5, 1.0])
    source = Texture(plain, (Reflection(light),))
    base = ibrpipe.render(plain, CAMERA).color
    first, last = list(render_progressive(source, CAMERA))
    np.testing.assert_allclose(first.color, base, atol=1e-6)
    gain = last.color - base
    single = ibrpipe.render(Texture(sheets([RED], [1], None), (Reflection(light),)), CAMERA).color - RED
    np.testing.assert_allclose(gain[3, 4], single[3, 4], atol=0.01)
    assert single[3, 4].min() > 0.2


def test_opaque_layers_keep_order_and_sizes():
    source = sheets([RED, GREEN, BLUE], [1, 4, 8], [0.25, 0.5, 1.0])
    kept = opaque(source)
    assert kept.coverage is None
    assert (np.diff(kept.offsets, axis=1) == 2).all()
    np.testing.assert_array_equal(kept.depth[:2], [4, 8])
    hard = sheets([RED], [1], None)
    assert opaque(hard) is hard


def test_threads_and_searches_change_no_byte():
    random = np.random.default_rng(11)
    counts = random.integers(0, 5, (20, 20))
    depth = np.concatenate([np.sort(random.uniform(1, 9, n)) for n in counts.ravel()])
    color, normal = random.random((len(depth), 3)), np.tile([0.0, 0.1, 1.0], (len(depth), 1))
    coverage = random.integers(1, 17, len(depth)) / 16
    source = LayeredDepthImage(frame_at(20), offsets_of(counts), depth, color, normal, None, coverage)
    camera = ibrpipe.Camera.look_at((18, 14, 40), (10, 10, -4), up=(0, 1, 0), fov_y_deg=30, width=61, height=47)
    one, two, three = (
        ibrpipe.render(source, camera, **options)
        for options in ({"threads": 1}, {"threads": 2}, {"search": "quadtree"})
    )
    assert ((one.alpha > 0) & (one.alpha < 1)).mean() > 0.1
    for name in ("color", "alpha", "depth"):
        assert getattr(one, name).tobytes() == getattr(two, name).tobytes()
    np.testing.assert_allclose(one.alpha, three.alpha, atol=1e-4)


def test_edges_are_means_of_rays_that_each_see_past_rims():
    """Against whole pictures of nine rays a pixel, whose rays pass through the same places."""
    half = sheets([RED, GREEN, BLUE], [1, 4, 8], [0.25, 0.5, 1.0])
    keep = np.arange(len(half.depth)) // 3 % 12 < 6  # the left half of it, before a ground that shows all around
    counts = np.where(np.arange(12) < 6, 3, 0)[None].repeat(12, axis=0)
    left = LayeredDepthImage(
        half.frame, offsets_of(counts), half.depth[keep], half.color[keep], half.normal[keep], None, half.coverage[keep]
    )
    camera = ibrpipe.Camera.look_at((6, 6, 40), (6, 6, 0), up=(0, 1, 0), fov_y_deg=17, width=37, height=31)
    adaptive, nine, one = (ibrpipe.render(left, camera, samples=samples) for samples in ("adaptive", 9, 1))
    edges = np.abs(adaptive.alpha - one.alpha) > 1e-3
    assert adaptive.stats["edge_pixels"] >= edges.sum() > 40
    np.testing.assert_allclose(adaptive.alpha[edges], nine.alpha[edges], atol=0.12)  # places are rounded to 64ths
    assert np.abs(adaptive.alpha[edges] - nine.alpha[edges]).mean() < 0.01
    covered = edges & (nine.alpha > 0.2)
    np.testing.assert_allclose(adaptive.color[covered], nine.color[covered], atol=0.05)
    np.testing.assert_array_equal(adaptive.depth, one.depth)
