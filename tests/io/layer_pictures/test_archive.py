"""The compact form of layers: round trips with and without losses, bounds of the losses, damaged and hostile files."""

from __future__ import annotations

import json
import zipfile
import zlib
from dataclasses import replace

import numpy as np
import pytest

from ibrpipe.core.color import srgb_decode, srgb_encode
from ibrpipe.errors import FormatError, MissingFileError, ResourceError
from ibrpipe.io.layer_pictures import LOSSLESS, NAME, Coding, read_layer_pictures, write_layer_pictures
from ibrpipe.io.layer_pictures.archive import MOST_TEXELS
from ibrpipe.io.layers import frame_as_json
from ibrpipe.types import Camera, LayeredDepthImage, ParallelFrame
from ibrpipe.types.layers import offsets_of

FRAME = ParallelFrame((0.1, -2, 3), (0.5, 0, 0), (0, 0.25, 0.1), (0, 0, 1))
CAMERA = Camera.look_at((1, 2, -5), (0, 0, 0), width=7, height=5)
LOSSY = Coding(color_quality=95, depth_step=0.125, normal_bits=10)

DERIVED = Coding(color_quality=95, depth_step=0.125, normal_bits=12, normal_tolerance=4)
PICTURED = Coding(color_quality=80, depth_step=0.125, normal_quality=80)
BLOCKS = Coding(codewords=256, depth_step=0.125, normal_bits=10)


def random_layers(frame=FRAME, seed=40, height=5, width=7, empty=0.3, most=4):
    """0 to `most` samples per texel with unit normals."""
    rng = np.random.default_rng(seed)
    counts = np.where(rng.random((height, width)) < empty, 0, rng.integers(1, most + 1, (height, width)))
    total = int(counts.sum())
    depth = np.concatenate([np.sort(1 + rng.random(n)) for n in counts.ravel()] + [np.zeros(0)]).astype(np.float32)
    normal = rng.normal(size=(total, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    color = srgb_decode(rng.integers(0, 256, (total, 3)) / 255.0).astype(np.float32)
    return LayeredDepthImage(frame, offsets_of(counts), depth, color, normal, rng.integers(0, 60, total))


def smooth_layers(height=40, width=50):
    """One layer of slopes in colour and depth, with a round hole."""
    v, u = np.mgrid[:height, :width] / 40.0
    there = (u - 0.5) ** 2 + (v - 0.5) ** 2 > 0.05
    depth = (2.0 + 0.3 * u + 0.2 * np.sin(3 * v)).astype(np.float32)[there]
    color = np.stack([0.2 + 0.5 * u / 1.3, 0.3 + 0.4 * v, 0.5 * u * v], axis=2)[there]
    normal = np.broadcast_to([0.0, 0.6, -0.8], (len(depth), 3))
    return LayeredDepthImage(FRAME, offsets_of(there), depth, color, normal, np.full(len(depth), 3, np.int32))


def through(layers, tmp_path, coding):
    write_layer_pictures(layers, tmp_path / NAME, coding)
    return read_layer_pictures(tmp_path / NAME)


def assert_same(back, layers):
    for name in ("offsets", "depth", "color", "normal", "observers"):
        found, wanted = getattr(back, name), getattr(layers, name)
        assert found.dtype == wanted.dtype
        assert found.tobytes() == wanted.tobytes(), name
    assert frame_as_json(back.frame) == frame_as_json(layers.frame)


@pytest.mark.parametrize("frame", [FRAME, CAMERA])
def test_lossless_gives_back_every_bit(tmp_path, frame):
    layers = random_layers(frame)
    assert_same(through(layers, tmp_path, LOSSLESS), layers)


def test_lossless_whatever_the_floats_are(tmp_path):
    layers, rng = random_layers(), np.random.default_rng(5)
    total = len(layers.depth)
    color = (10.0 ** rng.uniform(-30, 30, (total, 3))).astype(np.float32)
    normal = np.array(layers.normal)
    normal[:3] = [np.nan, -0.0, 1.0]
    odd = replace(layers, color=color, normal=normal, depth=layers.depth * np.float32(1e-20))
    assert_same(through(odd, tmp_path, LOSSLESS), odd)


def test_lossless_keeps_colours_that_were_held_as_half_floats(tmp_path):
    layers = random_layers()
    layers = replace(layers, color=layers.color.astype(np.float16).astype(np.float32))
    assert_same(through(layers, tmp_path, LOSSLESS), layers)
    with zipfile.ZipFile(tmp_path / NAME) as archive:
        assert "color_0.jxl" in archive.namelist()


@pytest.mark.parametrize("coding", [LOSSLESS, LOSSY, BLOCKS, DERIVED, PICTURED])
@pytest.mark.parametrize(
    ("height", "width", "empty", "most"),
    [(1, 1, 0.0, 1), (1, 1, 1.0, 1), (1, 6, 0.5, 3), (4, 1, 0.5, 3), (3, 3, 1, 1), (2, 3, 0, 90), (1, 900, 0.1, 2)],
)
def test_small_empty_and_deep_textures(tmp_path, coding, height, width, empty, most):
    layers = random_layers(height=height, width=width, empty=empty, most=most)
    back = through(layers, tmp_path, coding)
    np.testing.assert_array_equal(back.offsets, layers.offsets)
    np.testing.assert_array_equal(back.observers > 0, layers.observers > 0)
    np.testing.assert_allclose(back.depth, layers.depth, atol=0.125 * np.hypot(0.25, 0.1) / 2)


def test_losses_stay_within_what_was_asked_for(tmp_path):
    layers = smooth_layers()
    back = through(layers, tmp_path, LOSSY)
    pitch = float(np.hypot(0.25, 0.1))
    assert np.abs(back.depth - layers.depth).max() <= 0.5 * 0.125 * pitch * (1 + 1e-5)
    assert np.abs(back.depth - layers.depth).max() > 0.1 * 0.125 * pitch
    error = srgb_encode(back.color) - srgb_encode(layers.color)
    assert 38 < -10 * np.log10((error**2).mean()) < 70
    assert (back.normal * layers.normal).sum(axis=1).min() > np.cos(np.radians(0.5))
    np.testing.assert_allclose(np.linalg.norm(back.normal, axis=1), 1, atol=1e-6)


def test_finer_settings_cost_more_and_err_less(tmp_path):
    layers, sizes, errors = smooth_layers(), [], []
    for quality, share in ((40, 0.5), (70, 0.125), (95, 0.03)):
        coding = Coding(color_quality=quality, depth_step=share, normal_bits=8)
        back = through(layers, tmp_path, coding)
        sizes.append((tmp_path / NAME).stat().st_size)
        errors.append([np.abs(back.depth - layers.depth).mean(), np.abs(back.color - layers.color).mean()])
    assert sizes == sorted(sizes)
    assert (np.diff(np.array(errors), axis=0) < 0).all()


def test_the_depth_step_of_a_perspective_frame_is_that_of_its_nearest_sample(tmp_path):
    layers = random_layers(CAMERA)
    back = through(layers, tmp_path, LOSSY)
    pitch = layers.depth.min() / CAMERA.K[0, 0]
    assert np.abs(back.depth - layers.depth).max() <= 0.5 * 0.125 * pitch * (1 + 1e-4)


def test_depths_that_are_coarser_already_are_kept_as_they_are(tmp_path):
    layers = random_layers()
    coarse = replace(layers, depth=np.round(layers.depth * 2) / 2)
    np.testing.assert_array_equal(through(coarse, tmp_path, LOSSY).depth, coarse.depth)


def test_light_above_one_survives(tmp_path):
    layers = smooth_layers()
    bright = replace(layers, color=layers.color * 6)
    back = through(bright, tmp_path, LOSSY)
    assert np.abs(back.color - bright.color).max() < 0.15
    assert back.color.max() > 2


def test_half_chroma_takes_less_and_errs_more(tmp_path):
    rng, layers = np.random.default_rng(6), smooth_layers()
    layers = replace(layers, color=srgb_decode(rng.random((len(layers.depth), 3))).astype(np.float32))
    sizes, errors = [], []
    for half in (None, True):
        coding = Coding(color_quality=90, half_chroma=half)
        back = through(layers, tmp_path, coding)
        sizes.append((tmp_path / NAME).stat().st_size)
        errors.append(float(((srgb_encode(back.color) - srgb_encode(layers.color)) ** 2).mean()))
    assert sizes[1] < 0.8 * sizes[0]
    assert errors[1] > 2 * errors[0]


@pytest.mark.parametrize("coding", [LOSSY, PICTURED])
def test_unknown_normals_and_observers_stay_unknown(tmp_path, coding):
    layers = random_layers()
    normal = np.array(layers.normal)
    normal[::3] = np.nan
    bare = replace(layers, normal=normal, observers=None)
    back = through(bare, tmp_path, coding)
    assert back.observers is None
    np.testing.assert_array_equal(np.isnan(back.normal), np.isnan(normal))


@pytest.mark.parametrize("coding", [LOSSLESS, LOSSY])
def test_coverage_comes_back_exactly(tmp_path, coding):
    plain = random_layers()
    layers = replace(plain, coverage=(1 + np.arange(len(plain.depth)) % 16) / 16)
    write_layer_pictures(layers, tmp_path / NAME, coding)
    np.testing.assert_array_equal(read_layer_pictures(tmp_path / NAME).coverage, layers.coverage)
    write_layer_pictures(plain, tmp_path / NAME, coding)
    assert read_layer_pictures(tmp_path / NAME).coverage is None


def test_samples_without_light_stay_declared(tmp_path):
    layers = random_layers()
    layers = replace(layers, observers=layers.observers % 3)
    back = through(layers, tmp_path, LOSSY)
    np.testing.assert_array_equal(back.observers == 0, layers.observers == 0)
    assert (back.observers == 0).any()


def test_the_same_layers_give_the_same_bytes(tmp_path):
    write_layer_pictures(random_layers(), tmp_path / "a.zip", LOSSY)
    write_layer_pictures(random_layers(), tmp_path / "b.zip", LOSSY)
    assert (tmp_path / "a.zip").read_bytes() == (tmp_path / "b.zip").read_bytes()


def test_missing_and_unwritable(tmp_path):
    with pytest.raises(MissingFileError, match=r"layers\.zip: no such file"):
        read_layer_pictures(tmp_path / NAME)
    with pytest.raises(ResourceError, match="cannot write"):
        write_layer_pictures(random_layers(), tmp_path / "none" / NAME, LOSSLESS)


@pytest.fixture
def file(tmp_path):
    write_layer_pictures(random_layers(), tmp_path / NAME, LOSSY)
    return tmp_path / NAME


def rewrite(file, change, kind=zipfile.ZIP_STORED):
    """Change header and parts of an archive and write it again."""
    with zipfile.ZipFile(file) as archive:
        parts = {name: archive.read(name) for name in archive.namelist()}
    header = json.loads(parts["layers.json"])
    change(header, parts)
    parts["layers.json"] = json.dumps(header).encode()
    with zipfile.ZipFile(file, "w", kind) as archive:
        for name, data in parts.items():
            archive.writestr(name, data)


def bomb(header, parts):
    parts["occupancy"] = zlib.compress(bytes(50_000_000))


def other_picture(header, parts):
    parts["color_0.jxl"] = parts["color_3.jxl"]


def no_picture(header, parts):
    parts["color_0.jxl"] = b"no picture"


@pytest.mark.parametrize("change", [other_picture, no_picture])
def test_hostile_jpeg_xl_ends_in_one_line(tmp_path, change):
    file = tmp_path / NAME
    write_layer_pictures(random_layers(), file, LOSSY.model_copy(update={"color_quality": 98}))
    rewrite(file, change)
    with pytest.raises(FormatError, match="copy the asset again") as caught:
        read_layer_pictures(file)
    assert "\n" not in str(caught.value)


def no_normals(header, parts):
    parts["normal.avif"] = parts["color.avif"]


def test_hostile_pictures_of_normals_end_in_one_line(tmp_path):
    file = tmp_path / NAME
    write_layer_pictures(random_layers(), file, PICTURED)
    rewrite(file, no_normals)
    with pytest.raises(FormatError, match="copy the asset again"):
        read_layer_pictures(file)


@pytest.mark.parametrize(
    "change",
    [
        lambda header, parts: header.update(schema=2),
        lambda header, parts: header.update(height=-5),
        lambda header, parts: header.update(height=5.0),
        lambda header, parts: header.update(height=True),
        lambda header, parts: header.update(width=MOST_TEXELS),
        lambda header, parts: header.update(width=8),
        lambda header, parts: header.update(samples=[10**15]),
        lambda header, parts: header.update(samples=[1] * 2000),
        lambda header, parts: header.update(samples=7),
        lambda header, parts: header["samples"].append(1),
        lambda header, parts: header["samples"].pop(),
        lambda header, parts: header["depth"].update(step=-1.0),
        lambda header, parts: header["depth"].update(step=1e300),
        lambda header, parts: header["depth"].update(step="0.1"),
        lambda header, parts: header["depth"].pop("step"),
        lambda header, parts: header["color"].update(coding="neural"),
        lambda header, parts: header["color"].update(top=float("nan")),
        lambda header, parts: header["color"].update(held="double"),
        lambda header, parts: header["normal"].update(bits=99),
        lambda header, parts: header["normal"].update(coding="x"),
        lambda header, parts: header["observers"].update(coding="x"),
        lambda header, parts: header["frame"].update(projection="perspective"),
        lambda header, parts: header.pop("frame"),
        lambda header, parts: parts.pop("occupancy"),
        lambda header, parts: parts.update(depth_0=parts["depth_0"][:-3]),
        lambda header, parts: parts.update(depth_0=b""),
        lambda header, parts: parts.update(depth_0=b"\x09\x01" + parts["depth_0"][2:]),
        lambda header, parts: parts.update(depth_0=b"\x00\xff" + parts["depth_0"][2:]),
        lambda header, parts: parts.update({"color.avif": b"no picture"}),
        lambda header, parts: parts.update({"color.avif": parts["color.avif"][:-40]}),
        lambda header, parts: parts.pop("color.avif"),
        bomb,
    ],
)
def test_hostile_files_end_in_one_line(file, change):
    rewrite(file, change)
    with pytest.raises(FormatError, match=r"layers\.zip: damaged .*copy the asset again") as caught:
        read_layer_pictures(file)
    assert "\n" not in str(caught.value)


def test_an_archive_that_is_packed_once_more_is_refused(file):
    rewrite(file, lambda header, parts: parts.update(more=bytes(10**7)), zipfile.ZIP_DEFLATED)
    with pytest.raises(FormatError, match="packed once more"):
        read_layer_pictures(file)


def test_random_damage_never_ends_in_anything_but_one_clear_line(file):
    whole, rng, told = file.read_bytes(), np.random.default_rng(41), []
    for _ in range(150):
        damaged = bytearray(whole)
        for place in rng.integers(0, len(whole), rng.integers(1, 20)):
            damaged[place] = rng.integers(256)
        file.write_bytes(bytes(damaged[: rng.integers(len(whole))] if rng.random() < 0.3 else damaged))
        try:
            read_layer_pictures(file)
        except FormatError as error:
            told.append(str(error))
    assert len(told) > 120
    assert all(message.startswith(str(file)) and "\n" not in message for message in told)


def test_blocks_are_exact_while_there_are_words_for_all(tmp_path):
    layers = random_layers()
    assert_same(replace(through(layers, tmp_path, BLOCKS), depth=layers.depth, normal=layers.normal,
                        observers=layers.observers), layers)  # fmt: skip


def test_more_words_err_less(tmp_path):
    layers, errors = smooth_layers(), []
    for words in (2, 16, 128):
        back = through(layers, tmp_path, Coding(codewords=words))
        errors.append(np.abs(srgb_encode(back.color) - srgb_encode(layers.color)).mean())
    assert errors[0] > 2 * errors[1] > 4 * errors[2] > 0


@pytest.mark.parametrize("name", ["color_words", "color_blocks"])
def test_missing_words_and_blocks(tmp_path, name):
    write_layer_pictures(random_layers(), tmp_path / NAME, BLOCKS)
    rewrite(tmp_path / NAME, lambda header, parts: parts.update({name: parts[name][:12]}))
    with pytest.raises(FormatError, match="damaged"):
        read_layer_pictures(tmp_path / NAME)


def plane_layers(frame, normal, distance, height, width):
    """A plane n . X = distance seen by the frame, in one layer, with a hole."""
    normal = np.array(normal) / np.linalg.norm(normal)
    v, u = np.mgrid[:height, :width] + 0.5
    if isinstance(frame, Camera):
        rays = frame.pixel_rays()
        depth = (distance - frame.center @ normal) / (rays @ normal)
        facing = normal * -np.sign(rays[0, 0] @ normal)
    else:
        start = frame.origin + u[..., None] * frame.a + v[..., None] * frame.b
        depth = (distance - start @ normal) / (frame.f @ normal)
        facing = normal * -np.sign(frame.f @ normal)
    there = np.ones((height, width), bool)
    there[2:4, 3:5] = False
    count = int(there.sum())
    return LayeredDepthImage(
        frame,
        offsets_of(there),
        depth[there],
        np.full((count, 3), 0.5),
        np.tile(facing, (count, 1)),
        np.ones(count, int),
    )


@pytest.mark.parametrize("frame", [FRAME, CAMERA])
@pytest.mark.parametrize("normal", [(0.1, 0.2, -1), (-0.5, 0.3, -1)])
def test_normals_of_a_plane_are_had_from_depth(tmp_path, frame, normal):
    layers = plane_layers(frame, normal, 0.4 if frame is CAMERA else -9.0, 5, 7)
    coding = Coding(depth_step=1e-3, normal_bits=3, normal_tolerance=2)
    back = through(layers, tmp_path, coding)
    assert (back.normal * layers.normal).sum(axis=1).min() > np.cos(np.radians(0.5))  # 3 bits alone are ten degrees off


def test_normals_that_depth_does_not_give_are_kept(tmp_path):
    layers = random_layers()
    back = through(layers, tmp_path, DERIVED)
    assert (back.normal * layers.normal).sum(axis=1).min() > np.cos(np.radians(4.01))
    wild = through(layers, tmp_path, DERIVED.model_copy(update={"normal_tolerance": 180.0}))
    assert (wild.normal * layers.normal).sum(axis=1).min() < 0


@pytest.mark.parametrize("name", ["normal_given", "normal_2"])
def test_missing_normals(tmp_path, name):
    write_layer_pictures(random_layers(), tmp_path / NAME, DERIVED)
    rewrite(tmp_path / NAME, lambda header, parts: parts.update({name: zlib.compress(bytes(3))}))
    with pytest.raises(FormatError, match="damaged"):
        read_layer_pictures(tmp_path / NAME)


def test_a_tolerance_needs_bits_for_the_rest():
    with pytest.raises(ValueError, match="needs normal_bits"):
        Coding(normal_tolerance=5)
