"""The truth of synthetic captures against closed forms written down a second time, plainly."""

from __future__ import annotations

import math

import numpy as np
import pytest

from ibrpipe.synthetic.capture import SynthConfig, plan_views
from ibrpipe.synthetic.light import Lamp, SoftBox, Studio
from ibrpipe.synthetic.paints import glazed_ball
from ibrpipe.synthetic.photograph import measure_truth, take_photo
from ibrpipe.synthetic.scene import Gloss, Part, Scene, StagedScene, prepare_scene
from ibrpipe.synthetic.scenes import glossy, lambert, plain_ball
from ibrpipe.synthetic.surfaces import ball, lobed_ball
from ibrpipe.types import Camera

EYE = np.array([2.5, -3.0, 1.2])
CAMERA = Camera.look_at(EYE, (0.1, 0.05, -0.1), fov_y_deg=34, width=40, height=30)


@pytest.fixture(scope="module")
def sphere() -> StagedScene:
    return prepare_scene(plain_ball(1.0), occlusion_rays=0)


def ray(camera: Camera, x: float, y: float) -> np.ndarray:
    """Direction with camera z = 1 of a point of the image plane."""
    return camera.R.T @ np.array([(x - camera.K[0, 2]) / camera.K[0, 0], (y - camera.K[1, 2]) / camera.K[1, 1], 1.0])


def sphere_depth(camera: Camera, x: float, y: float) -> float:
    """Depth of the unit sphere along camera z, +inf = missed."""
    d, o = ray(camera, x, y), camera.center
    a, b, c = d @ d, 2 * d @ o, o @ o - 1
    inside = b * b - 4 * a * c
    return (-b - math.sqrt(inside)) / (2 * a) if inside > 0 else math.inf


def test_depth_is_the_spheres(sphere: StagedScene) -> None:
    found = measure_truth(sphere, CAMERA).depth
    wanted = np.array([[sphere_depth(CAMERA, j + 0.5, i + 0.5) for j in range(40)] for i in range(30)])
    rim = np.array([[abs(rim_distance(CAMERA, j + 0.5, i + 0.5) - 1) < 0.01 for j in range(40)] for i in range(30)])
    np.testing.assert_array_equal(np.isfinite(found)[~rim], np.isfinite(wanted)[~rim])
    both = np.isfinite(found) & np.isfinite(wanted) & ~rim
    assert 300 < both.sum() < 1000
    error = found[both] - wanted[both]
    # the mesh is inscribed: its 1-degree faces lie at most 8e-5 below the sphere, more when seen at a slant
    assert error.min() > -1e-5
    assert error.max() < 3e-3
    assert error.mean() > 1e-6


def rim_distance(camera: Camera, x: float, y: float) -> float:
    """Distance of a ray from the sphere's middle."""
    d = ray(camera, x, y)
    return float(np.linalg.norm(np.cross(camera.center, d)) / np.linalg.norm(d))


def test_normals_are_radial(sphere: StagedScene) -> None:
    truth = measure_truth(sphere, CAMERA)
    for i, j in np.argwhere(np.isfinite(truth.depth))[::37]:
        point = CAMERA.center + truth.depth[i, j] * ray(CAMERA, j + 0.5, i + 0.5)
        np.testing.assert_allclose(truth.normal[i, j], point / np.linalg.norm(point), atol=2e-4)
    assert (truth.normal[~np.isfinite(truth.depth)] == 0).all()


def plain_studio(studio: Studio, d: np.ndarray) -> np.ndarray:
    """Radiance from one direction, written out with scalars."""

    def step(x: float) -> float:
        t = min(max(x, 0.0), 1.0)
        return t * t * (3 - 2 * t)

    up = max(d[2], 0.0)
    horizon, zenith, ground = (np.array(c) for c in (studio.horizon, studio.zenith, studio.ground))
    light = horizon + (zenith - horizon) * (1 - (1 - up) ** 2)
    light = light * (1 - step((0.08 - d[2]) / 0.25)) + ground * step((0.08 - d[2]) / 0.25)
    for box in studio.boxes:
        a, e = math.radians(box.azimuth_deg), math.radians(box.elevation_deg)
        middle = np.array([math.cos(e) * math.cos(a), math.cos(e) * math.sin(a), math.sin(e)])
        right = np.array([-math.sin(a), math.cos(a), 0.0])
        up_axis = np.cross(middle, right)
        depth = d @ middle
        if depth <= 0:
            continue
        x, y = abs(d @ right) / depth, abs(d @ up_axis) / depth
        share = step((box.half_width - x) / box.softness) * step((box.half_height - y) / box.softness)
        light = light + share * np.array(box.radiance)
    return light


def plain_color(scene: Scene, point: np.ndarray, eye: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Diffuse and coat light of a point of the unit sphere, written out with scalars."""
    studio, gloss = scene.studio, scene.parts[0].gloss
    n, v = point / np.linalg.norm(point), (eye - point) / np.linalg.norm(eye - point)
    sky = (np.array(studio.zenith) + studio.horizon) / 2
    light = sky * (1 + n[2]) / 2 + np.array(studio.ground) * (1 - n[2]) / 2
    glints = np.zeros(3)
    mirrored = 2 * (n @ v) * n - v
    for box in studio.boxes:
        a, e = math.radians(box.azimuth_deg), math.radians(box.elevation_deg)
        cosine = n @ (math.cos(e) * math.cos(a), math.cos(e) * math.sin(a), math.sin(e))
        area = (2 * box.half_width - box.softness) * (2 * box.half_height - box.softness)
        light = light + area / math.pi * max(cosine, 0) * np.array(box.radiance)
    for lamp in studio.lamps:
        a, e = math.radians(lamp.azimuth_deg), math.radians(lamp.elevation_deg)
        to_lamp = np.array([math.cos(e) * math.cos(a), math.cos(e) * math.sin(a), math.sin(e)])
        light = light + max(n @ to_lamp, 0) * np.array(lamp.irradiance)
        glints += max(mirrored @ to_lamp, 0) ** gloss.exponent * np.array(lamp.radiance)
    f0, f90 = gloss.normal_reflectance, gloss.grazing_reflectance
    fresnel = f0 * (1 - (1 - n @ v) ** 5) + f90 * (1 - n @ v) ** 5
    return glazed_ball(point[None])[0] * light, fresnel * (plain_studio(studio, mirrored) + glints)


def test_colours_are_the_closed_form_at_one_ray_per_pixel(sphere: StagedScene) -> None:
    photo, truth = take_photo(sphere, CAMERA, 1), measure_truth(sphere, CAMERA)
    hit = np.isfinite(truth.depth)
    np.testing.assert_array_equal(photo.coverage, hit)
    brightest = 0.0
    for i, j in np.argwhere(hit)[::7]:
        point = EYE + truth.depth[i, j] * ray(CAMERA, j + 0.5, i + 0.5)
        # the normal is interpolated over 1-degree facets; the mirrored soft boxes amplify what it is off
        if np.linalg.norm(np.cross(point, EYE - point)) > 0.98 * np.linalg.norm(EYE - point):
            continue
        diffuse, coat = plain_color(sphere.scene, point, EYE)
        np.testing.assert_allclose(photo.diffuse[i, j], diffuse, rtol=2e-4, atol=1e-5)
        np.testing.assert_allclose(photo.color[i, j], diffuse + coat, rtol=1e-2, atol=2e-3)
        brightest = max(brightest, float(coat.max()))
    assert brightest > 0.2  # a reflection was among them


def test_more_rays_per_pixel_average_the_finer_picture(sphere: StagedScene) -> None:
    fine = take_photo(sphere, CAMERA.resized(120, 90), 1)
    coarse = take_photo(sphere, CAMERA, 3)
    averaged = fine.coverage.reshape(30, 3, 40, 3).mean(axis=(1, 3))
    np.testing.assert_allclose(coarse.coverage, averaged, atol=1e-12)
    inside = coarse.coverage == 1
    color = fine.color.reshape(30, 3, 40, 3, 3).mean(axis=(1, 3))
    np.testing.assert_allclose(coarse.color[inside], color[inside], rtol=1e-6, atol=1e-9)


def test_the_backdrop_fills_what_the_object_leaves(sphere: StagedScene) -> None:
    photo = take_photo(sphere, CAMERA, 2)
    top, bottom = sphere.scene.backdrop
    empty = photo.coverage[0] == 0
    assert empty.any()
    np.testing.assert_allclose(
        photo.color[0, empty], np.tile(np.array(top) + (np.array(bottom) - top) / 60, (empty.sum(), 1))
    )


def test_a_white_matt_ball_returns_the_irradiance() -> None:
    studio = Studio((0.5,) * 3, (0.5,) * 3, (0.5,) * 3)
    part = Part("ball", ball(lobed_ball(1.0, 1, 0.0, 1.0), 60, 30), lambda points: np.ones_like(points))
    photo = take_photo(prepare_scene(Scene("white", "", (part,), studio), 0), CAMERA, 1)
    np.testing.assert_allclose(photo.color[photo.coverage == 1], 0.5, atol=1e-12)


def test_a_perfect_mirror_shows_the_room() -> None:
    room = (
        Studio(
            (1.0, 0.5, 0.2),
        )
        * 1
        if False
        else Studio((0.7,) * 3, (0.7,) * 3, (0.7,) * 3)
    )
    shape = ball(lobed_ball(1.0, 1, 0.0, 1.0), 60, 30)
    part = Part("ball", shape, lambda points: np.zeros_like(points), Gloss(1.0, 1.0, 10.0))
    photo = take_photo(prepare_scene(Scene("mirror", "", (part,), room), 0), CAMERA, 1)
    np.testing.assert_allclose(photo.color[photo.coverage == 1], 0.7, atol=1e-12)


def test_a_soft_box_has_its_size_and_place() -> None:
    box = SoftBox(30.0, 20.0, 0.3, 0.1, 0.05, (1.0, 1.0, 1.0))
    middle, right, up = box.axes
    probes = np.stack(
        [middle, middle + 0.24 * right, middle + 0.31 * right, middle + 0.04 * up, middle + 0.11 * up, -middle]
    )
    probes /= np.linalg.norm(probes, axis=1, keepdims=True)
    np.testing.assert_array_equal(box.shape(probes) > 0.999, [True, True, False, True, False, False])
    np.testing.assert_array_equal(box.shape(probes) > 0, [True, True, False, True, False, False])
    assert right[2] == pytest.approx(0)
    assert up[2] > 0


def test_a_soft_box_lights_what_faces_it_by_the_area_of_its_shape() -> None:
    box = SoftBox(0.0, 0.0, 0.3, 0.2, 0.1, (1.0, 1.0, 1.0))
    y, z = np.meshgrid(np.linspace(-0.5, 0.5, 401), np.linspace(-0.5, 0.5, 401))
    area = box.shape(
        np.stack([np.ones(y.size), y.ravel(), z.ravel()], axis=1)
    ).mean()  # the grid spans one unit squared
    assert box.power == pytest.approx(area / math.pi, rel=0.01)


def test_a_lamp_is_brightest_where_it_is_mirrored() -> None:
    studio = Studio((0.0,) * 3, (0.0,) * 3, (0.0,) * 3, (), (Lamp(90.0, 0.0, (2.0, 1.0, 0.5), (0.0,) * 3),))
    there, off = np.array([[0.0, 1.0, 0.0]]), np.array([[math.sin(0.1), math.cos(0.1), 0.0]])
    np.testing.assert_allclose(studio.glints(there, 50.0)[0], (2.0, 1.0, 0.5))
    np.testing.assert_allclose(studio.glints(off, 50.0)[0], np.array((2.0, 1.0, 0.5)) * math.cos(0.1) ** 50)


def test_a_convex_scene_is_open_and_a_hollow_is_not() -> None:
    assert prepare_scene(plain_ball(0.3), 32).openness.min() == 1.0
    staged = prepare_scene(glossy(0.4), 32)
    ring = np.unique(staged.caster.mesh.faces[staged.part == 1])
    inner = ring[np.linalg.norm(staged.caster.mesh.vertices[ring], axis=1) < 1.30]
    outer = ring[np.linalg.norm(staged.caster.mesh.vertices[ring], axis=1) > 1.44]
    assert staged.openness[inner].mean() < 0.6
    assert staged.openness[outer].mean() > 0.95


@pytest.mark.parametrize(("make", "share"), [(glossy, 0.05), (lambert, 0.03)])
def test_several_layers_face_the_camera(make, share: float) -> None:
    staged = prepare_scene(make(0.35), 0)
    (camera, *_), _ = plan_views(staged, SynthConfig(photos=4, tests=0, width=64, height=48))
    x, y = np.meshgrid(np.arange(64) + 0.5, np.arange(48) + 0.5)
    rays = (np.stack([x, y, np.ones_like(x)], axis=-1) @ camera.world_from_pixel.T).reshape(-1, 3)
    index, hits = staged.caster.cast_all(np.broadcast_to(camera.center, rays.shape), rays)
    a, b, c = (staged.caster.mesh.vertices[staged.caster.mesh.faces[hits.face][:, i]] for i in range(3))
    front = (np.cross(b - a, c - a) * rays[index]).sum(axis=1) < 0
    layers = np.bincount(index[front], minlength=len(rays))
    assert (layers >= 2).sum() > share * (layers >= 1).sum()
    assert layers.max() <= 8


def test_the_lambert_scene_does_not_depend_on_the_view(tiny_lambert) -> None:
    staged = prepare_scene(lambert(0.35), 0)
    cameras, _ = plan_views(staged, SynthConfig(photos=4, tests=0, width=64, height=48))
    photo = take_photo(staged, cameras[1], 1)
    np.testing.assert_array_equal(photo.color, photo.diffuse)
    for test in sorted((tiny_lambert / "test" / "images").iterdir()):
        assert test.read_bytes() == (tiny_lambert / "test" / "diffuse" / test.name).read_bytes()


def test_the_glossy_scene_does(tiny_glossy) -> None:
    from ibrpipe.io.photos.images import read_coverage, read_image

    for test in sorted((tiny_glossy / "test" / "images").iterdir()):
        mask = read_coverage(tiny_glossy / "test" / "masks" / test.name) == 1
        difference = (read_image(test) - read_image(tiny_glossy / "test" / "diffuse" / test.name))[mask]
        assert difference.min() > -0.01
        assert (difference.max(axis=1) > 0.1).mean() > 0.02
        assert np.median(difference.max(axis=1)) < 0.1
