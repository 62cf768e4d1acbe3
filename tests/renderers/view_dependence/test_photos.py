"""Pictures from kept photos: what the nearest photos that see a place show, against a plain twin."""

from __future__ import annotations

import numpy as np
import photo_twin
import pytest
from kernel_runs import on_all_thread_counts
from photo_twin import Photo

import ibrpipe
from ibrpipe.core.color import srgb_encode
from ibrpipe.errors import RendererError, ShapeError, ValueRangeError
from ibrpipe.renderers.ldi.renderer import find_hits
from ibrpipe.renderers.scene import prepare
from ibrpipe.renderers.view_dependence.photos import RULES
from ibrpipe.types import (
    Asset,
    Blend,
    Camera,
    KeptPhoto,
    KeptPhotos,
    LayeredDepthImage,
    ParallelFrame,
    PhotoBlend,
    Texture,
)

SIDE = 24
MIDDLE = (0.5, 0.5, 0.1)
CAMERA = Camera.look_at((-0.5, 0.7, 1.1), MIDDLE, width=30, height=24)


def sheet(origin, a, b, f, width=SIDE, height=SIDE):
    """Gray layers of one plane, 1 before the frame's zero."""
    frame = ParallelFrame(np.array(origin, float), np.array(a, float), np.array(b, float), np.array(f, float))
    offsets = np.arange(height)[:, None] * width + np.arange(width + 1)
    count = width * height
    return LayeredDepthImage(frame, offsets, np.ones(count), np.full((count, 3), 0.2), np.tile(-frame.f, (count, 1)))


def layers():
    """A floor z = 0, x and y from 0 to 1, and a roof over a corner of it at z = 0.4 that looks up."""
    step = 1 / SIDE
    floor = sheet((0, 0, 1), (step, 0, 0), (0, step, 0), (0, 0, -1))
    roof = sheet((0, 0, 1.4), (step, 0, 0), (0, step, 0), (0, 0, -1), SIDE // 2, SIDE // 2)
    return floor, roof


def cameras(count=7):
    places = [(0.5 + 1.1 * np.cos(n), 0.5 + 1.1 * np.sin(n), 1.0 + 0.1 * n) for n in range(count)]
    return [Camera.look_at(place, MIDDLE, width=40 + n, height=36) for n, place in enumerate(places)]


def kept(seed=3, **figures):
    """Photos of smooth random codes, some pixels of which do not show the object."""
    rng = np.random.default_rng(seed)
    photos = []
    for camera in cameras():
        shape = (camera.height, camera.width)
        codes = np.kron(rng.integers(30, 220, (6, 8, 3)), np.ones((6, 6, 1)))[: shape[0], : shape[1]]
        photos.append(KeptPhoto(camera, codes.astype(np.uint8), rng.random(shape) > 0.1))
    return KeptPhotos(tuple(photos), **figures)


def asset(photos, parts=(True, True)):
    blend = PhotoBlend(photos)
    return Asset(tuple(Texture(each, (blend,) if own else ()) for each, own in zip(layers(), parts, strict=True)))


def twin(photos, camera, asked=None):
    """(color (H, W, 3) linear or NaN, hit (H, W)): every pixel on its own, by plain rules."""
    scene, how = prepare(layers()), photos.blend
    shown = [
        Photo(p.camera, p.codes * (photos.top / 255), find_hits(scene, p.camera).depth, p.shown.astype(float))
        for n, p in enumerate(photos.photos)
        if asked is None or n in asked
    ]
    depth = find_hits(scene, camera).depth
    out, rays = np.full((*depth.shape, 3), np.nan), camera.pixel_rays()
    for row, column in zip(*np.nonzero(np.isfinite(depth)), strict=True):
        ray = rays[row, column]
        point, toward = camera.center + depth[row, column] * ray, -ray / np.linalg.norm(ray)
        code, _ = photo_twin.blend(
            shown, point, np.array([0.0, 0.0, 1.0]), toward, *RULES, how.photos, how.falloff, how.sharpness
        )
        out[row, column] = code
    return out, np.isfinite(depth)


@pytest.mark.parametrize(
    ("blend", "top"),
    [(Blend(4), 1.0), (Blend(3), 1.6), (Blend(2), 1.0), (Blend(5, 1.0), 1.0), (Blend(4, 0.75, 0.5), 1.6)],
)
def test_every_pixel_as_its_twin_whatever_the_threads(blend, top):
    photos = kept(blend=blend, top=top)
    prepared = ibrpipe.prepare(asset(photos), "ldi")
    (color,) = on_all_thread_counts(lambda: (ibrpipe.render(prepared, CAMERA).color,))
    wanted, hit = twin(photos, CAMERA)
    seen = hit & np.isfinite(wanted[..., 0])
    assert seen.sum() > 200
    np.testing.assert_allclose(srgb_encode(color[seen], np.inf), np.clip(wanted[seen], 0, top), atol=2e-3)
    unseen = hit & ~seen
    np.testing.assert_allclose(color[unseen], 0.2, atol=1e-6)


def test_what_no_photo_sees_keeps_its_own_colour_and_is_told():
    """From straight above nothing is seen of what lies under the roof."""
    above = Camera.look_at((0.25, 0.25, 3.0), (0.25, 0.25, 0.0), up=(0, 1, 0), fov_y_deg=40, width=40, height=40)
    high = KeptPhotos((KeptPhoto(above, np.full((40, 40, 3), 99, np.uint8), np.ones((40, 40), bool)),))
    low = Camera.look_at((0.3, 2.0, 0.5), (0.25, 0.25, 0.1), width=60, height=48)
    frame = ibrpipe.render(asset(high), low)
    wanted, hit = twin(high, low)
    unseen = hit & ~np.isfinite(wanted[..., 0])
    assert unseen.sum() > 20
    np.testing.assert_allclose(frame.color[unseen], 0.2, atol=1e-6)
    assert frame.stats["without_photo"] == pytest.approx(unseen.sum(), abs=2)
    assert frame.stats["from_photos"] + frame.stats["without_photo"] == hit.sum()


def test_only_textures_that_ask_are_changed():
    plain = ibrpipe.render(asset(kept(), (True, False)), CAMERA)
    both = ibrpipe.render(asset(kept()), CAMERA)
    points = CAMERA.center + plain.depth[..., None] * CAMERA.pixel_rays()
    roof = np.isfinite(plain.depth) & (points[..., 2] > 0.2)
    assert roof.sum() > 30
    np.testing.assert_allclose(plain.color[roof], 0.2, atol=1e-6)
    assert (np.abs(both.color[roof] - 0.2).max(axis=1) > 1e-3).mean() > 0.9
    floor = np.isfinite(plain.depth) & (points[..., 2] < 0.1)
    np.testing.assert_array_equal(plain.color[floor], both.color[floor])


def test_a_photo_shows_itself_unless_it_is_to_be_predicted():
    photos = kept(blend=Blend(2))  # the second is only the bar
    first = photos.photos[0]
    shown = ibrpipe.render(asset(photos), first.camera)
    hit = np.isfinite(shown.depth) & first.shown
    hit[[0, -1]], hit[:, [0, -1]] = False, False
    assert np.abs(srgb_encode(shown.color[hit]) * 255 - first.codes[hit]).max() < 1.0
    predicted = ibrpipe.render(asset(photos).predicting(), first.camera)
    wanted, _ = twin(photos, first.camera, asked=range(1, 7))
    seen = hit & np.isfinite(wanted[..., 0])
    np.testing.assert_allclose(srgb_encode(predicted.color[seen]), wanted[seen], atol=2e-3)
    assert np.abs(predicted.color - shown.color)[seen].mean() > 0.02
    assert asset(photos).predicting().shared["photos"] is photos.predicting
    elsewhere = ibrpipe.render(asset(photos).predicting(), CAMERA).color
    np.testing.assert_array_equal(elsewhere, ibrpipe.render(asset(photos), CAMERA).color)


def test_cut_photos_show_the_same():
    cut = []
    for photo in kept().photos:
        whole = photo.camera
        camera = Camera(
            whole.K - np.array([[0, 0, 3], [0, 0, 2], [0, 0, 0]]),
            whole.cam_from_world,
            whole.width - 7,
            whole.height - 4,
        )
        window = slice(2, whole.height - 2), slice(3, whole.width - 4)
        inside = np.zeros_like(photo.shown)
        inside[3 : whole.height - 3, 4 : whole.width - 5] = photo.shown[3 : whole.height - 3, 4 : whole.width - 5]
        cut.append((KeptPhoto(whole, photo.codes, inside), KeptPhoto(camera, photo.codes[window], inside[window])))
    one, other = (ibrpipe.render(asset(KeptPhotos(tuple(each))), CAMERA).color for each in zip(*cut, strict=True))
    np.testing.assert_allclose(one, other, atol=1e-5)


@pytest.mark.parametrize("renderer", ["epipolar", "splat"])
def test_other_renderers_ask_the_same_photos(renderer):
    photos = kept()
    one, other = (ibrpipe.render(asset(photos), CAMERA, name) for name in ("ldi", renderer))
    both = (one.alpha > 0) & (other.alpha > 0)
    assert both.sum() > 200
    assert np.abs(srgb_encode(one.color) - srgb_encode(other.color))[both].mean() < 0.02
    assert other.stats["from_photos"] > 200


def test_edges_are_smooth_where_asked():
    frame = ibrpipe.render(asset(kept()), CAMERA, samples="adaptive")
    plain = ibrpipe.render(asset(kept()), CAMERA)
    assert frame.stats["edge_pixels"] > 10
    inner = (plain.alpha > 0) & (frame.alpha == 1) & np.isclose(frame.color, plain.color).all(axis=-1)
    assert inner.sum() > 200


def test_a_surface_in_view_of_nothing_is_drawn_in_its_own_colours():
    away = Camera.look_at((0.5, 0.5, -2), (0.5, 0.5, -3), width=8, height=6)
    photos = KeptPhotos((KeptPhoto(away, np.zeros((6, 8, 3), np.uint8), np.ones((6, 8), bool)),))
    frame = ibrpipe.render(asset(photos), CAMERA)
    np.testing.assert_allclose(frame.color[np.isfinite(frame.depth)], 0.2, atol=1e-6)
    assert frame.stats["from_photos"] == 0


def test_photos_of_two_assets_are_not_mixed():
    floor, roof = layers()
    textures = [Texture(each, (PhotoBlend(kept(seed)),)) for seed, each in enumerate((floor, roof))]
    with pytest.raises(RendererError, match="textures keep 2 sets of photos"):
        ibrpipe.prepare(textures)


def test_what_cannot_be_is_refused():
    camera = cameras()[0]
    codes, shown = np.zeros((36, 40, 3), np.uint8), np.ones((36, 40), bool)
    good = KeptPhoto(camera, codes, shown)
    with pytest.raises(ShapeError, match="must be as large as the camera's picture"):
        KeptPhoto(camera, codes[:-1], shown)
    with pytest.raises(ShapeError, match="must be as large as the camera's picture"):
        KeptPhoto(camera, codes, shown[:, :-1])
    with pytest.raises(ShapeError, match="photos must be 1 to"):
        KeptPhotos(())
    for figures, words in (({"top": np.nan}, "top is nan"), ({"top": 0.5}, "top is 0.5")):
        with pytest.raises(ValueRangeError, match=words):
            KeptPhotos((good,), **figures)
    for figures, words in (
        ((1,), "1 photos are blended"),
        ((9,), "9"),
        ((4, -1), "falloff"),
        ((4, 0, np.nan), "sharp"),
    ):
        with pytest.raises(ValueRangeError, match=words):
            Blend(*figures)
    assert "7 photos" in repr(kept())
    assert KeptPhotos((good,)).bytes == codes.nbytes + shown.nbytes
