"""Several rays a pixel: means of larger pictures, edges alone, every renderer, a smaller error against the truth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from small_fields import layers, relief

import ibrpipe
from ibrpipe.errors import RendererError
from ibrpipe.renderers import antialiasing
from ibrpipe.renderers.antialiasing import supersample
from ibrpipe.renderers.edges import edge_pixels
from ibrpipe.renderers.ldi import edge_rays
from ibrpipe.types import Camera, ParallelFrame, ReliefTexture
from ibrpipe.types.layers import single_layer

CAMERA = Camera.look_at((2.13, 1.07, -9.1), (4.1, 3.03, 1), width=40, height=30)


def disc(size=48):
    """A disc of one colour before a wall of another, as one layered image, and as a height field."""
    v, u = np.mgrid[:size, :size] + 0.5
    near = np.hypot(u - size / 2, v - size / 2) < size / 3.1
    depth = np.where(near, 3.0, 9.0)
    color = np.where(near[..., None], (0.9, 0.1, 0.1), (0.1, 0.2, 0.8))
    frame = ParallelFrame((0, 0, 0), (0.1, 0, 0), (0, 0.1, 0), (0, 0, 1))
    normal = np.broadcast_to((0.0, 0.0, -1.0), (*near.shape, 3))
    layered = single_layer(frame, depth, color, normal)
    return layered, ReliefTexture(frame, color, depth)


VIEW = Camera.look_at((2.9, 2.0, -6.0), (2.4, 2.4, 3.0), width=44, height=36, fov_y_deg=40)


def error(frame, truth):
    both = np.concatenate([frame.color * frame.alpha[..., None], frame.alpha[..., None]], axis=2)
    return float(np.sqrt(np.mean((both - truth) ** 2)))


@pytest.mark.parametrize("renderer", ["ldi", "epipolar", "splat"])
def test_edges_come_nearer_to_the_truth(renderer):
    prepared = ibrpipe.prepare(disc()[0], renderer)
    truth = supersample(lambda camera, names: ibrpipe.render(prepared, camera, renderer, names), VIEW,
                        ("color", "depth", "alpha"), 256)  # fmt: skip
    truth = np.concatenate([truth.color * truth.alpha[..., None], truth.alpha[..., None]], axis=2)
    frames = {samples: ibrpipe.render(prepared, VIEW, renderer, samples=samples) for samples in (1, "adaptive", 4, 16)}
    found = {samples: error(frame, truth) for samples, frame in frames.items()}
    assert found[4] < 0.6 * found[1]
    assert found["adaptive"] < 0.6 * found[1]
    assert found[16] < 0.6 * found[4]
    one, adaptive = frames[1], frames["adaptive"]
    edges = edge_pixels(one.depth, one.alpha) > 0
    assert 0.02 < edges.mean() < 0.4
    np.testing.assert_array_equal(adaptive.color[~edges], one.color[~edges])
    np.testing.assert_array_equal(adaptive.alpha[~edges], one.alpha[~edges])
    np.testing.assert_array_equal(adaptive.depth, one.depth)
    assert ((adaptive.alpha > 0) & (adaptive.alpha < 1)).any()


def test_height_fields_and_searches_by_rays_draw_edges_alike():
    layered, height = disc()
    for source, options in ((height, {}), (layered, {"search": "quadtree"})):
        prepared = ibrpipe.prepare(source)
        one, four = (ibrpipe.render(prepared, VIEW, samples=samples, **options) for samples in (1, 4))
        adaptive = ibrpipe.render(prepared, VIEW, samples="adaptive", **options)
        edges = edge_pixels(one.depth, one.alpha) > 0
        np.testing.assert_array_equal(adaptive.color, np.where(edges[..., None], four.color, one.color))
        assert adaptive.stats["edge_pixels"] == edges.sum() > 0


@pytest.mark.parametrize("samples", [4, 9, "adaptive"])
def test_threads_change_no_byte(samples):
    prepared = ibrpipe.prepare([layers((20, 26), seed=5), layers()])
    one, two = (ibrpipe.render(prepared, CAMERA, samples=samples, threads=threads) for threads in (1, 2))
    for name in ("color", "depth", "alpha"):
        np.testing.assert_array_equal(getattr(one, name), getattr(two, name))


@pytest.mark.parametrize("renderer", sorted(ibrpipe.renderers()))
def test_every_renderer_draws_several_rays(renderer):
    if "samples" not in ibrpipe.renderers()[renderer]["options"]:
        pytest.skip(f"{renderer} has no samples")
    if "ReliefTexture" not in ibrpipe.renderers()[renderer]["accepts"]:
        pytest.skip(f"{renderer} draws no relief texture; its own tests try its samples")
    source = relief()
    prepared = ibrpipe.prepare(source, renderer)
    large = ibrpipe.render(prepared, CAMERA.resized(80, 60), renderer)
    four = ibrpipe.render(prepared, CAMERA, renderer, samples=4)
    np.testing.assert_allclose(four.alpha, large.alpha.reshape(30, 2, 40, 2).mean(axis=(1, 3)), atol=1e-6)
    total = (large.color * large.alpha[..., None]).reshape(30, 2, 40, 2, 3).mean(axis=(1, 3))
    np.testing.assert_allclose(four.color * four.alpha[..., None], total, atol=1e-5)
    assert ((four.alpha > 0) & (four.alpha < 1)).any()
    adaptive = ibrpipe.render(prepared, CAMERA, renderer, samples="adaptive")
    assert ((adaptive.alpha > 0) & (adaptive.alpha < 1)).any()


@pytest.mark.parametrize("samples", [4, 9, "adaptive"])
@pytest.mark.parametrize("renderer", ["ldi", "epipolar", "relief", "splat", "prewarp"])
def test_bands_are_what_is_drawn_in_one_go(renderer, samples, monkeypatch):
    prepared = ibrpipe.prepare(relief(), renderer)
    whole = ibrpipe.render(prepared, CAMERA, renderer, samples=samples)
    monkeypatch.setattr(antialiasing, "MOST_RAYS", 1500)  # nine rows of four rays a pixel, four of nine
    bands = ibrpipe.render(prepared, CAMERA, renderer, samples=samples)
    assert bands.stats["rays"] == whole.stats["rays"]
    for name in ("color", "depth", "alpha"):
        one, other = getattr(whole, name), getattr(bands, name)
        if renderer == "prewarp":  # its passes resample in coordinates of the picture, which round otherwise in a band
            np.testing.assert_allclose(other, one, atol=1e-5)
        else:
            np.testing.assert_array_equal(other, one)


def test_edges_in_bands_are_those_in_one_go(monkeypatch):
    prepared = ibrpipe.prepare(layers((20, 26), seed=5))
    whole = ibrpipe.render(prepared, CAMERA, samples="adaptive")
    asked = edge_pixels(*(getattr(ibrpipe.render(prepared, CAMERA), name) for name in ("depth", "alpha")))
    monkeypatch.setattr(edge_rays, "MOST_RAYS", 9 * 40)
    bands = ibrpipe.render(prepared, CAMERA, samples="adaptive")
    assert bands.stats["edge_pixels"] == whole.stats["edge_pixels"] == asked.sum() > 80
    assert bands.stats["rays"] == whole.stats["rays"]
    for name in ("color", "depth", "alpha"):
        np.testing.assert_array_equal(getattr(bands, name), getattr(whole, name))


@pytest.mark.parametrize("most", [9, 90, 9000])
def test_bands_of_edges_hold_every_edge_once(most, monkeypatch):
    monkeypatch.setattr(edge_rays, "MOST_RAYS", most)
    known = np.zeros((30, 20), np.float32)
    known[4:6, 3:9], known[15:25, 1:18] = 1, 1
    depth = np.where(known > 0, 5, np.inf).astype(np.float32)
    bands = edge_rays.edge_bands(depth, known)
    asked = edge_pixels(depth, known)
    np.testing.assert_array_equal(np.sum(bands, axis=0), asked)
    sizes, rows = [int(band.sum()) for band in bands], [int(band.any(axis=1).sum()) for band in bands]
    assert min(sizes) > 0
    assert all(9 * size <= most or count == 1 for size, count in zip(sizes, rows))
    assert edge_rays.edge_bands(np.full_like(depth, np.inf), np.zeros_like(known)) == []


def test_no_band_has_more_rays_than_allowed(monkeypatch):
    drawn = []

    def draw(camera, names):
        drawn.append(camera.width * camera.height)
        return ibrpipe.Frame(None, None, np.ones((camera.height, camera.width), np.float32))

    monkeypatch.setattr(antialiasing, "MOST_RAYS", 1500)
    frame = supersample(draw, CAMERA, ("alpha",), 9)
    assert max(drawn) <= 1500
    assert sum(drawn) == frame.stats["rays"] == 9 * 40 * 30


def test_rays_are_those_that_were_cast():
    layered, height = disc()
    pixels = VIEW.width * VIEW.height
    traced, whole = (ibrpipe.render(source, VIEW, samples="adaptive").stats for source in (layered, height))
    assert traced["rays"] == pixels + 9 * traced["edge_pixels"]
    assert whole["rays"] == 5 * pixels
    assert ibrpipe.render(layered, VIEW, samples=16).stats["rays"] == 16 * pixels


@pytest.mark.parametrize("source", disc())
def test_depth_alone_is_drawn_with_one_ray(source):
    one, adaptive = (ibrpipe.render(source, VIEW, samples=each, outputs=("depth",)) for each in (1, "adaptive"))
    np.testing.assert_array_equal(adaptive.depth, one.depth)
    assert adaptive.stats["rays"] == VIEW.width * VIEW.height


def test_depth_is_that_of_the_ray_farther_than_half_of_them():
    prepared = ibrpipe.prepare(layers((20, 26), seed=5))
    large = ibrpipe.render(prepared, CAMERA.resized(80, 60)).depth
    rays = np.sort(np.moveaxis(large.reshape(30, 2, 40, 2), 1, 2).reshape(30, 40, 4), axis=2)
    np.testing.assert_array_equal(ibrpipe.render(prepared, CAMERA, samples=4, outputs=("depth",)).depth, rays[..., 1])


def test_only_what_is_asked_for_is_in_the_frame():
    for samples in (4, "adaptive"):
        frame = ibrpipe.render(layers(), CAMERA, outputs=("color",), samples=samples)
        assert frame.color is not None
        assert frame.depth is None
        assert frame.alpha is None


def test_wrong_numbers_are_told():
    with pytest.raises(RendererError, match=r"samples is 5; choose among: 1, 4, 9, 16, 64, adaptive"):
        ibrpipe.render(layers(), CAMERA, samples=5)


def test_a_picture_without_edges_stays_as_it_is():
    layered = disc()[0]
    flat = replace(layered, depth=np.full_like(layered.depth, 5.0))
    camera = Camera.look_at((2.4, 2.4, -1.0), (2.4, 2.4, 3.0), width=20, height=16, fov_y_deg=20)
    one, adaptive = (ibrpipe.render(flat, camera, samples=samples) for samples in (1, "adaptive"))
    assert adaptive.stats["edge_pixels"] == 0
    np.testing.assert_array_equal(adaptive.color, one.color)
