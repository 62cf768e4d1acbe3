"""Diffuse colour looked up in layered depth images, parallel and perspective, against a plain twin."""

from __future__ import annotations

import numpy as np
import photo_twin
import pytest
from kernel_runs import on_all_thread_counts

from ibrpipe.core.appearance.diffuse_lookup import lookup_diffuse
from ibrpipe.modelling.diffuse import DiffuseSource
from ibrpipe.modelling.rectangles import Rectangle
from ibrpipe.types import LayeredDepthImage, ParallelFrame

#: three rectangles over the same volume: from below, from the side, and a perspective one
RECTANGLES = (
    Rectangle("low", np.array([-1, -1, -1.0]), np.array([2, 0, 0.0]), np.array([0, 2, 0.0]), 6, 5),
    Rectangle("side", np.array([-1, -1, -1.0]), np.array([0, 2, 0.0]), np.array([0, 0, 2.0]), 5, 7),
    Rectangle(
        "eye", np.array([-1, -1, -1.0]), np.array([2, 0, 0.0]), np.array([0, 2, 0.0]), 7, 6, np.array([0.2, 0.1, -3])
    ),
)


def random_layers(rectangle, seed):
    rng = np.random.default_rng(seed)
    counts = rng.integers(0, 4, (rectangle.height, rectangle.width))
    ends = np.cumsum(counts).reshape(counts.shape)
    offsets = np.concatenate([np.r_[0, ends[:-1, -1]][:, None], ends], axis=1)
    near = 0.0 if rectangle.center is None else 2.0
    depth = np.concatenate([np.sort(near + 2 * rng.random(n)) for n in counts.ravel()])
    observers = rng.choice([0, 1, 5], len(depth), p=[0.15, 0.2, 0.65])
    color = rng.random((len(depth), 3))
    return LayeredDepthImage(rectangle.frame, offsets, depth, color, np.full((len(depth), 3), np.nan), observers)


def points_and_normals(count, seed):
    rng = np.random.default_rng(seed)
    normals = rng.normal(size=(count, 3))
    return rng.uniform(-1.1, 1.1, (count, 3)), normals / np.linalg.norm(normals, axis=1, keepdims=True)


@pytest.mark.parametrize("chosen", [(0,), (2,), (0, 1, 2)])
def test_lookup_as_twin_whatever_the_threads(chosen):
    rectangles = [RECTANGLES[i] for i in chosen]
    layers = [random_layers(rectangle, 20 + i) for i, rectangle in enumerate(rectangles)]
    points, normals = points_and_normals(300, 21)
    source = DiffuseSource(rectangles, layers)
    (color,) = on_all_thread_counts(lambda: (source.at(points, normals),))
    facing = np.stack([r.facing(points, normals) for r in rectangles], axis=1)
    texels = [np.linalg.norm(r.u) / r.width for r in rectangles]
    wanted = np.array([photo_twin.lookup_diffuse(p, f, texels, layers) for p, f in zip(points, facing)])
    np.testing.assert_allclose(color, wanted, atol=1e-5)
    assert 30 < np.isnan(wanted[:, 0]).sum() < 270


def flat_layers(rectangle, color, observers):
    """One sample per texel, half way through the volume."""
    height, width = rectangle.height, rectangle.width
    offsets = np.arange(height)[:, None] * width + np.arange(width + 1)
    count = height * width
    return LayeredDepthImage(
        rectangle.frame, offsets, np.ones(count), np.tile(color, (count, 1)), np.zeros((count, 3)), observers
    )


def test_the_texture_that_faces_best_answers_and_the_next_steps_in():
    low, side = RECTANGLES[:2]
    point, normal = np.zeros((1, 3)), np.array([[-0.6, 0.0, -0.8]])
    all_seen, none_seen = (lambda n: np.ones(n, np.int32)), (lambda n: np.zeros(n, np.int32))

    def ask(observers_low):
        layers = [flat_layers(low, (1.0, 0, 0), observers_low(30)), flat_layers(side, (0, 1.0, 0), all_seen(35))]
        return DiffuseSource((low, side), layers).at(point, normal)[0]

    np.testing.assert_allclose(ask(all_seen), (1, 0, 0), atol=1e-6)
    np.testing.assert_allclose(ask(none_seen), (0, 1, 0), atol=1e-6)  # nobody saw it there: not black


def test_no_colour_is_taken_from_another_depth():
    low = RECTANGLES[0]
    source = DiffuseSource((low,), [flat_layers(low, (1.0, 0, 0), np.ones(30, np.int32))])
    normal = np.array([[0, 0, -1.0]])
    texel = 2 / 6
    near, far = np.array([[0, 0, 1.4 * texel]]), np.array([[0, 0, 1.6 * texel]])
    assert np.isfinite(source.at(near, normal)).all()
    assert np.isnan(source.at(far, normal)).all()


def test_no_points():
    low = RECTANGLES[0]
    source = DiffuseSource((low,), [flat_layers(low, (1.0, 0, 0), np.ones(30, np.int32))])
    assert source.at(np.empty((0, 3)), np.empty((0, 3))).shape == (0, 3)


@pytest.mark.parametrize("count", [0, 1, 200])
def test_the_kernel_on_two_small_textures_with_holes(count):
    frame, rng, layers = ParallelFrame((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)), np.random.default_rng(7), []
    for shape in ((3, 4), (1, 2)):
        counts = rng.integers(0, 3, shape)
        ends = np.cumsum(counts).reshape(shape)
        offsets = np.concatenate([np.r_[0, ends[:-1, -1]][:, None], ends], axis=1)
        depth = np.concatenate([np.sort(4 * rng.random(n)) for n in counts.ravel()])
        seen = rng.integers(0, 2, len(depth)).astype(np.int32)
        color = rng.random((len(depth), 3))
        layers.append(LayeredDepthImage(frame, offsets, depth, color, np.zeros_like(color), seen))
    points, facing = rng.uniform(0, 4, (count, 3)), rng.uniform(-0.3, 1, (count, 2))
    starts = np.array([0, len(layers[0].depth), len(layers[0].depth) + len(layers[1].depth)])
    joint = [np.concatenate([getattr(each, name) for each in layers]) for name in ("depth", "color", "observers")]

    def look_up():
        color = np.zeros((count, 3), np.float32)
        lookup_diffuse(
            points, facing, np.stack([np.eye(4), np.eye(4)]), np.ones(2), tuple(each.offsets for each in layers),
            starts, *joint, color,
        )  # fmt: skip
        return (color,)

    (color,) = on_all_thread_counts(look_up)
    wanted = [photo_twin.lookup_diffuse(p, f, [1.0, 1.0], layers) for p, f in zip(points, facing)]
    np.testing.assert_allclose(color, np.reshape(wanted, (count, 3)), atol=1e-5)
    assert count < 200 or 20 < np.isnan(color[:, 0]).sum() < 180
