"""Deep OpenEXR of layers: read back by the third-party package OpenEXR and by ibrpipe; damaged and foreign files."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ibrpipe.errors import FormatError, MissingFileError, ResourceError
from ibrpipe.io.layers import CHANNELS, frame_as_json, frame_from_json, read_layers, write_layers
from ibrpipe.io.photos.images import write_exr
from ibrpipe.types import Camera, LayeredDepthImage, ParallelFrame

FRAME = ParallelFrame((0.1, -2, 3), (0.5, 0, 0), (0, 0.25, 0.1), (0, 0, 1))
CAMERA = Camera.look_at((1, 2, -5), (0, 0, 0), width=7, height=5)


def random_layers(frame=FRAME, seed=40, height=5, width=7, empty=0.3):
    """0 to 4 samples per pixel; colours and normals that half floats hold exactly."""
    rng = np.random.default_rng(seed)
    counts = np.where(rng.random((height, width)) < empty, 0, rng.integers(1, 5, (height, width)))
    ends = np.cumsum(counts).reshape(counts.shape)
    offsets = np.concatenate([np.r_[0, ends[:-1, -1]][:, None], ends], axis=1)
    total = int(counts.sum())
    depth = np.concatenate([np.sort(1 + rng.random(n)) for n in counts.ravel()] + [np.zeros(0)]).astype(np.float32)
    color, normal = rng.integers(0, 1024, (total, 3)) / 512, rng.integers(-64, 65, (total, 3)) / 64
    return LayeredDepthImage(frame, offsets, depth, color, normal, rng.integers(0, 60, total))


@pytest.fixture
def file(tmp_path):
    write_layers(random_layers(), tmp_path / "layers.exr")
    return tmp_path / "layers.exr"


@pytest.mark.parametrize("frame", [FRAME, CAMERA])
def test_round_trip_is_exact(tmp_path, frame):
    layers = random_layers(frame)
    write_layers(layers, tmp_path / "a.exr")
    back = read_layers(tmp_path / "a.exr")
    for name in ("offsets", "depth", "color", "normal", "observers"):
        np.testing.assert_array_equal(getattr(back, name), getattr(layers, name), err_msg=name)
    assert frame_as_json(back.frame) == frame_as_json(layers.frame)


def test_coverage_survives_but_for_samples_that_no_photo_saw(tmp_path):
    plain = random_layers()
    layers = replace(plain, coverage=(1 + np.arange(len(plain.depth)) % 16) / 16)
    write_layers(layers, tmp_path / "a.exr")
    seen = layers.observers > 0
    assert 0 < seen.sum() < len(seen)
    np.testing.assert_array_equal(read_layers(tmp_path / "a.exr").coverage, np.where(seen, layers.coverage, 1.0))
    write_layers(replace(plain, coverage=np.ones(len(plain.depth))), tmp_path / "b.exr")
    assert read_layers(tmp_path / "b.exr").coverage is None


@pytest.mark.parametrize(("height", "width", "empty"), [(1, 1, 0.0), (1, 1, 1.0), (1, 6, 0.5), (4, 1, 0.5), (3, 3, 1)])
def test_small_and_empty_images(tmp_path, height, width, empty):
    layers = random_layers(height=height, width=width, empty=empty)
    write_layers(layers, tmp_path / "a.exr")
    back = read_layers(tmp_path / "a.exr")
    np.testing.assert_array_equal(back.offsets, layers.offsets)
    np.testing.assert_array_equal(back.depth, layers.depth)


def test_a_third_party_reader_finds_every_sample(file):
    OpenEXR = pytest.importorskip("OpenEXR")
    layers = random_layers()
    with OpenEXR.File(str(file), separate_channels=True) as opened:
        part = opened.parts[0]
        assert part.type() == OpenEXR.deepscanline
        assert set(part.channels) == set(CHANNELS)
        assert part.header["colorInteropID"] == "lin_rec709_scene"
        assert part.channels["Z"].type() == OpenEXR.FLOAT
        pixels = {name: part.channels[name].pixels for name in CHANNELS}
    columns = {"R": layers.color[:, 0], "G": layers.color[:, 1], "B": layers.color[:, 2], "Z": layers.depth}
    columns |= {f"N.{axis}": layers.normal[:, i] for i, axis in enumerate("xyz")}
    columns |= {"observers": layers.observers, "A": layers.observers > 0}
    for name, wanted in columns.items():
        assert pixels[name].shape == (5, 7)
        for row in range(5):
            for column in range(7):
                own = slice(layers.offsets[row, column], layers.offsets[row, column + 1])
                found = pixels[name][row, column]
                found = np.zeros(0) if found is None else found
                np.testing.assert_array_equal(np.asarray(found, float), wanted[own].astype(float), err_msg=name)


def test_the_same_layers_give_the_same_bytes(file, tmp_path):
    write_layers(random_layers(), tmp_path / "again.exr")
    assert (tmp_path / "again.exr").read_bytes() == file.read_bytes()


def test_unknown_normals_and_observers_are_written_as_none(tmp_path):
    layers = random_layers()
    bare = LayeredDepthImage(FRAME, layers.offsets, layers.depth, layers.color, np.full_like(layers.color, np.nan))
    write_layers(bare, tmp_path / "a.exr")
    back = read_layers(tmp_path / "a.exr")
    assert (back.observers == 1).all()
    assert (back.normal == 0).all()


@pytest.mark.parametrize("frame", [FRAME, CAMERA])
def test_frames_as_plain_values(frame):
    back = frame_from_json(frame_as_json(frame))
    assert type(back) is type(frame)
    assert frame_as_json(back) == frame_as_json(frame)


def test_missing_file(tmp_path):
    with pytest.raises(MissingFileError, match=r"layers\.exr: no such file"):
        read_layers(tmp_path / "layers.exr")


@pytest.mark.parametrize("size", [0, 10, 400, 0.5, 0.95])
def test_cut_short(file, size):
    whole = file.read_bytes()
    file.write_bytes(whole[: int(size * len(whole)) if isinstance(size, float) else size])
    with pytest.raises(FormatError, match=r"layers\.exr: .*copy the asset again") as caught:
        read_layers(file)
    assert "\n" not in str(caught.value)


def test_random_damage_never_ends_in_anything_but_one_clear_line(file):
    whole, rng, told = file.read_bytes(), np.random.default_rng(41), []
    for _ in range(150):
        damaged = bytearray(whole)
        for place in rng.integers(0, len(whole), rng.integers(1, 20)):
            damaged[place] = rng.integers(256)
        file.write_bytes(bytes(damaged))
        try:
            read_layers(file)
        except FormatError as error:
            told.append(str(error))
    assert len(told) > 120
    assert all(message.startswith(str(file)) and "\n" not in message for message in told)


def test_other_files_by_that_name(tmp_path):
    (tmp_path / "a.exr").write_text("hello")
    with pytest.raises(FormatError, match="copy the asset again"):
        read_layers(tmp_path / "a.exr")
    write_exr(tmp_path / "flat.exr", np.ones((3, 4, 3), np.float32))
    with pytest.raises(FormatError, match=r"expected a deep OpenEXR.*missing: A, Z"):
        read_layers(tmp_path / "flat.exr")


def test_no_such_folder(tmp_path):
    with pytest.raises(ResourceError, match="cannot write"):
        write_layers(random_layers(), tmp_path / "none" / "a.exr")
