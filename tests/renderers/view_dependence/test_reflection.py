"""Pictures under shared reflection: a floor mirrors a wall and the sky, and free rays find what pixels find."""

from __future__ import annotations

from dataclasses import replace
from importlib import import_module

import numba
import numpy as np
import pytest
from kernel_runs import on_all_thread_counts
from numba.core.sigutils import normalize_signature

import ibrpipe
from ibrpipe.errors import RendererError
from ibrpipe.renderers.ldi.progressive import render_progressive
from ibrpipe.renderers.ldi.renderer import find_hits, shade_hits
from ibrpipe.renderers.scene import prepare
from ibrpipe.renderers.view_dependence.component import Picture
from ibrpipe.renderers.view_dependence.mirror import LIFT, cast, look, make_surface, meet_surface
from ibrpipe.renderers.view_dependence.reflection import BACKGROUND, Model, look_through, shade_looks
from ibrpipe.types import ReflectedLight, Reflection

SIDE, SKY = 40, 0.25


def sheet(origin, a, b, f, color, depth=1.0):
    """Layers of one plane; `color` is a function of the (S, 3) world points."""
    frame = ibrpipe.ParallelFrame(np.array(origin, float), np.array(a, float), np.array(b, float), np.array(f, float))
    offsets = np.arange(SIDE)[:, None] * SIDE + np.arange(SIDE + 1)
    v, u = np.divmod(np.arange(SIDE * SIDE), SIDE)
    points = frame.origin + (u + 0.5)[:, None] * frame.a + (v + 0.5)[:, None] * frame.b + depth * frame.f
    normal = np.tile(-frame.f, (SIDE * SIDE, 1))
    return ibrpipe.LayeredDepthImage(frame, offsets, np.full(SIDE * SIDE, depth), color(points), normal)


def room(light=None, weights=(1.0, 0.0)):
    """A black mirror z = 0, x and y from 0 to 1, before a painted wall x = 1, z from 0 to 1."""
    step = 1 / SIDE
    floor = sheet((0, 0, 1), (step, 0, 0), (0, step, 0), (0, 0, -1), lambda points: 0 * points)
    paint = lambda points: 0.2 + 0.6 * points[:, [1, 2, 1]]  # noqa: E731
    wall = sheet((0, 0, 0), (0, step, 0), (0, 0, step), (1, 0, 0), paint)
    light = light or ReflectedLight(np.full((1, 16, 16, 3), SKY), (1.0,), 1.0)
    parts = [None if weight is None else Reflection(light, np.full((SIDE * SIDE, 1), weight)) for weight in weights]
    layers = (floor, wall)
    return ibrpipe.Asset(tuple(ibrpipe.Texture(x, () if p is None else (p,)) for x, p in zip(layers, parts)))


CAMERA = ibrpipe.Camera.look_at((-0.6, 0.5, 0.7), (0.7, 0.5, 0.2), width=64, height=48)


@pytest.mark.parametrize("wall_weight", [0.0, None])
def test_a_floor_mirrors_the_wall_and_the_sky(wall_weight):
    asset = room(weights=(1.0, wall_weight))
    prepared = ibrpipe.prepare(asset, "ldi")

    def draw():
        frame = ibrpipe.render(prepared, CAMERA)
        return frame.color, frame.depth

    color, depth = on_all_thread_counts(draw)
    points = CAMERA.center + depth[..., None] * CAMERA.pixel_rays()
    ways = CAMERA.pixel_rays() * (1, 1, -1)
    on_floor = np.isfinite(depth) & (np.abs(points[..., 2]) < 1e-4) & (points[..., 0] < 0.9)
    with np.errstate(divide="ignore", invalid="ignore"):
        end = points + ((1 - points[..., 0]) / ways[..., 0])[..., None] * ways + (0, 0, LIFT / SIDE)
    inside = 1.5 / SIDE
    meets = (end[..., 1:] > inside).all(axis=-1) & (end[..., 1:] < 1 - inside).all(axis=-1)
    misses = (end[..., 1:] < -inside).any(axis=-1) | (end[..., 1:] > 1 + inside).any(axis=-1)
    assert min((on_floor & meets).sum(), (on_floor & misses).sum()) > 100
    wanted = 0.2 + 0.6 * end[..., [1, 2, 1]]
    np.testing.assert_allclose(color[on_floor & meets], wanted[on_floor & meets], atol=2e-3)
    np.testing.assert_allclose(color[on_floor & misses], SKY, atol=1e-5)
    on_wall = np.isfinite(depth) & (np.abs(points[..., 0] - 1) < 1e-4) & (points[..., 2] > inside)
    painted = 0.2 + 0.6 * points[..., [1, 2, 1]]
    middle = on_wall & (points[..., 1:] > inside).all(axis=-1) & (points[..., 1:] < 1 - inside).all(axis=-1)
    if wall_weight is None:  # no reflection: nothing is damped either
        np.testing.assert_allclose(color[middle], painted[middle], atol=2e-3)
    assert middle.sum() > 50


def test_the_view_independent_picture_comes_first():
    plain = ibrpipe.render(room(weights=(None, None)), CAMERA)
    first, last = render_progressive(room(), CAMERA)
    np.testing.assert_array_equal(first.color, plain.color)
    assert np.abs(last.color - first.color).max() > 0.1
    assert last.stats["reflecting"] > 500


def test_free_rays_find_what_pixels_find():
    layers = [each.layers for each in room().textures]
    scene = prepare(tuple(layers))
    surface = make_surface(scene, np.concatenate([each.normal for each in layers]))
    hits, ways = find_hits(scene, CAMERA, "quadtree"), CAMERA.pixel_rays().reshape(-1, 3)
    t, patches = cast(surface, np.broadcast_to(CAMERA.center, ways.shape), ways)
    np.testing.assert_allclose(t, hits.depth.ravel(), rtol=1e-6)
    met = np.isfinite(t)
    assert met.any()
    assert (~met).any()
    assert (patches[met] == hits.ids.ravel()[met]).mean() > 0.999  # at equal depth either
    assert (patches[~met] == -1).all()
    none = cast(surface, np.empty((0, 3)), np.empty((0, 3)))
    assert none[0].shape == none[1].shape == (0,)


def test_places_without_patch_or_normal_mirror_nothing():
    layers = [each.layers for each in room().textures]
    scene = prepare(tuple(layers))
    normals = np.concatenate([each.normal for each in layers])
    normals[SIDE * SIDE :] = np.nan
    surface = make_surface(scene, normals)
    wall_patch = int(np.flatnonzero(surface.records[:, 2] == 1)[500])
    points = np.array([[0.5, 0.5, 0.0], [1.0, 0.5, 0.5], [5.0, 5.0, 5.0]])
    floor_patch = int(np.flatnonzero(surface.records[:, 2] == 0)[500])
    seen = look(surface, points, np.array([floor_patch, wall_patch, -1]), CAMERA.center, 16)
    assert np.isfinite(seen.reflected[0]).all()
    assert np.isnan(seen.reflected[1:]).all()
    met, _ = meet_surface(surface, seen, 16)
    assert set(met) <= {0}


def bowl():
    """A painted bowl z = 0.6 r^2 over x and y from -1 to 1 that mirrors itself and a sky of two tables, in half."""
    step, rng = 2 / SIDE, np.random.default_rng(2)
    v, u = np.divmod(np.arange(SIDE * SIDE), SIDE)
    x, y = (u + 0.5) * step - 1, (v + 0.5) * step - 1
    normal = np.stack([-1.2 * x, -1.2 * y, np.ones_like(x)], axis=1)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    paint = lambda points: 0.2 + 0.3 * np.abs(points[:, [0, 1, 0]])  # noqa: E731
    flat = sheet((-1, -1, 2), (step, 0, 0), (0, step, 0), (0, 0, -1), paint)
    layers = replace(flat, depth=2 - 0.6 * (x**2 + y**2), normal=normal)
    light = ReflectedLight(rng.uniform(0, 1, (2, 16, 16, 3)), (0.05, 0.9), 0.9)
    weights = rng.uniform(0, 1, (SIDE * SIDE, 2))
    return ibrpipe.Asset((ibrpipe.Texture(layers, (Reflection(light, weights),)),))


DOWN = ibrpipe.Camera.look_at((0.9, 0.4, 2.2), (0.0, 0.0, 0.3), width=64, height=48)


#: a tenth of a degree to two degrees above the floor
LOW = ibrpipe.Camera.look_at((-1.2, 0.5, 0.02), (1.0, 0.5, 0.0), fov_y_deg=3.0, width=96, height=64)


@pytest.mark.parametrize(
    ("asset", "camera"), [(room(), CAMERA), (bowl(), DOWN), (room(), LOW)], ids=["room", "bowl", "grazing"]
)
def test_a_picture_shows_what_looks_at_its_pixels_show(asset, camera):
    scene = prepare(asset.textures)
    (component,), hits = scene.components, find_hits(scene, camera)

    def draw():
        color, known = shade_hits(scene, hits, camera)
        stats = component.add(Picture(scene, camera, color, hits.depth, hits.ids, known))
        return color, np.array([stats["reflecting"], stats["met"]])

    color, counts = on_all_thread_counts(draw)
    mirrors = component.tables.of(scene)
    active = mirrors.active[np.append(mirrors.surface.records[:, 2], 0)[np.minimum(hits.ids, len(scene.records[0]))]]
    shown = np.isfinite(hits.depth) & active
    layers = np.concatenate([field.color for _, field in scene.patches])
    texels = np.concatenate([np.sqrt(layers[:, :3]), mirrors.weights], axis=1)
    light = asset.textures[0].component("reflection").light
    model = Model(texels.astype(np.float32), np.sqrt(light.tables), mirrors.law)
    seen = look_through(mirrors.surface, camera, hits.depth, hits.ids, shown, model.size)
    wanted = shade_looks(mirrors.surface, model, seen)
    np.testing.assert_allclose(color[shown], wanted, atol=1e-5)  # directions are float32
    met = np.isfinite(seen.traits[:, 9]).sum()
    assert counts[0] == shown.sum() > 500
    assert abs(counts[1] - met) <= 2
    assert met > 100
    plain, _ = shade_hits(scene, hits, camera)
    np.testing.assert_array_equal(color[~shown], plain[~shown])


def test_pixels_without_normal_stay_diffuse():
    asset = room()
    floor = asset.textures[0]
    bare = replace(floor, layers=replace(floor.layers, normal=np.full_like(floor.layers.normal, np.nan)))
    frame = ibrpipe.render([bare, asset.textures[1]], CAMERA)
    plain = ibrpipe.render([bare, asset.textures[1]], CAMERA, residuals=False)
    on_floor = np.abs((CAMERA.center + frame.depth[..., None] * CAMERA.pixel_rays())[..., 2]) < 1e-4
    assert on_floor.sum() > 500
    np.testing.assert_array_equal(frame.color[on_floor], plain.color[on_floor])


def test_textures_of_different_assets_are_refused():
    one, other = room(), room(ReflectedLight(np.ones((1, 8, 8, 3)), (0.5,)))
    with pytest.raises(RendererError, match="one asset"):
        ibrpipe.prepare([*one.textures, *other.textures], "ldi")
    part = one.textures[0].component("reflection")
    wrong = replace(part, weights=np.ones((3, 1)))
    with pytest.raises(RendererError, match="samples"):
        ibrpipe.prepare(ibrpipe.Texture(one.textures[0].layers, (wrong,)), "ldi")


def test_epipolar_draws_what_ldi_draws():
    wanted = ibrpipe.render(room(), CAMERA)
    frame = ibrpipe.render(room(), CAMERA, "epipolar")
    same = np.isfinite(wanted.depth) & np.isclose(frame.depth, wanted.depth, rtol=1e-5)
    assert same.mean() > 0.99 * np.isfinite(wanted.depth).mean()
    assert (np.abs(frame.color - wanted.color)[same].max(axis=-1) < 1e-3).mean() > 0.99
    plain = ibrpipe.render(room(weights=(None, None)), CAMERA, "epipolar")
    np.testing.assert_array_equal(ibrpipe.render(room(), CAMERA, "epipolar", residuals=False).color, plain.color)
    assert np.abs(frame.color - plain.color).max() > 0.1
    assert frame.stats["reflecting"] == wanted.stats["reflecting"]


@pytest.mark.parametrize(
    ("renderer", "options"),
    [("splat", {"footprint": 2.0}), ("epipolar", {"search": "nearest"}), ("epipolar", {"search": "linear"})],
)
def test_samples_mirror_as_the_surface_does(renderer, options):
    exact = ibrpipe.render(room(), CAMERA)

    def draw():
        frame = ibrpipe.render(room(), CAMERA, renderer, **options)
        return frame.color, frame.depth

    color, depth = on_all_thread_counts(draw)
    points = CAMERA.center + exact.depth[..., None] * CAMERA.pixel_rays()
    on_floor = np.isfinite(depth) & (np.abs(points[..., 2]) < 1e-4) & (points[..., 0] < 0.9)
    error = np.abs(color - exact.color).max(axis=-1)[on_floor]
    assert on_floor.sum() > 800
    assert np.median(error) < 0.02  # a texel of the wall's paint is 0.015
    assert (error < 0.05).mean() > 0.9


@pytest.mark.parametrize("renderer", ["epipolar", "splat"])
def test_a_reflection_of_soft_samples_loses_those_that_are_dropped(renderer):
    asset, rng = room(), np.random.default_rng(4)
    floor = asset.textures[0]
    coverage = np.where(rng.random(SIDE * SIDE) < 0.2, 0.25, 1.0).astype(np.float32)
    soft = replace(floor, layers=replace(floor.layers, coverage=coverage))
    frame = ibrpipe.render([soft, asset.textures[1]], CAMERA, renderer)
    assert frame.stats["reflecting"] > 300
    assert np.isfinite(frame.color).all()


@pytest.mark.skipif(numba.config.DISABLE_JIT, reason="nothing is compiled")
def test_what_a_second_process_compiles_is_what_a_frame_calls():
    ibrpipe.render(room(), CAMERA)
    for kernel in BACKGROUND.kernels:
        called = getattr(import_module(f"ibrpipe.core.{kernel.module}"), kernel.name).signatures
        assert normalize_signature(kernel.types)[0] in called, kernel.name


def test_float32_frames_cameras_and_tables_change_little():
    exact, rounded = room(), []
    for texture in exact.textures:
        frame = texture.layers.frame
        parts = [part.astype(np.float32) for part in (frame.origin, frame.a, frame.b, frame.f)]
        rounded.append(replace(texture, layers=replace(texture.layers, frame=ibrpipe.ParallelFrame(*parts))))
    camera = ibrpipe.Camera(
        CAMERA.K.astype(np.float32), CAMERA.cam_from_world.astype(np.float32), CAMERA.width, CAMERA.height
    )
    wanted, found = ibrpipe.render(exact, CAMERA), ibrpipe.render(rounded, camera)
    error = np.abs(wanted.color - found.color).max(axis=-1)
    assert (error > 1e-4).mean() < 0.005  # rays along borders
    assert abs(wanted.stats["met"] - found.stats["met"]) < 10
