"""Weights of a reflection as pictures beside the layers, and as bytes."""

from __future__ import annotations

import numpy as np
import pytest

import ibrpipe
from ibrpipe.errors import FormatError, MissingFileError, ValueRangeError
from ibrpipe.io.layer_pictures import Coding
from ibrpipe.io.recoding import through_files
from ibrpipe.types import LayeredDepthImage, ReflectedLight, Reflection
from ibrpipe.types.layers import offsets_of

FRAME = ibrpipe.ParallelFrame(np.zeros(3), np.array([1.0, 0, 0]), np.array([0, 1.0, 0]), np.array([0, 0, 1.0]))


def layers(height: int = 96, width: int = 128) -> LayeredDepthImage:
    v, u = np.mgrid[:height, :width]
    counts = 1 + ((u - 64) ** 2 + (v - 48) ** 2 < 900)
    total = int(counts.sum())
    depth = np.concatenate([np.arange(1.0, n + 1) for n in counts.ravel()])
    return LayeredDepthImage(
        FRAME, offsets_of(counts), depth, np.full((total, 3), 0.3), np.tile((0, 0, -1.0), (total, 1)),
        np.ones(total, np.int32),
    )  # fmt: skip


def reflection(own: LayeredDepthImage) -> Reflection:
    light = ReflectedLight(np.random.default_rng(2).random((2, 12, 12, 3)), (0.045, 0.9))
    place = np.repeat(np.arange(own.offsets.shape[0])[:, None], own.offsets.shape[1] - 1, 1).ravel()
    row = np.repeat(place, np.diff(own.offsets, axis=1).ravel())
    grain = np.random.default_rng(3).normal(0, 0.02, (len(row), 2))
    return Reflection(light, np.abs(np.column_stack([1.2 - row / 120, row / 100]) + grain).astype(np.float32))


def test_smooth_weights_take_few_bytes_as_pictures(tmp_path) -> None:
    own = layers()
    part = reflection(own)
    as_bytes = through_files(part, own, tmp_path / "100", 100)
    as_picture = through_files(part, own, tmp_path / "50", 50)
    assert as_picture[1] < 0.2 * as_bytes[1]
    for (read, _), tolerance in ((as_bytes, 0.003), (as_picture, 0.15)):
        assert isinstance(read, Reflection)
        assert read.light is part.light
        np.testing.assert_allclose(read.weights, part.weights, atol=tolerance)


def asset(folder):
    own = layers()
    written = ibrpipe.Asset((ibrpipe.Texture(own, (reflection(own),)),))
    ibrpipe.write_asset(written, folder, quality=60, coding=Coding(color_quality=80, depth_step=0.25))
    return written


def test_assets_with_pictures_of_weights_are_read(tmp_path) -> None:
    before = asset(tmp_path / "asset").textures[0].component("reflection").weights
    assert (tmp_path / "asset/texture_00/reflection_weights.avif").is_file()
    np.testing.assert_allclose(
        ibrpipe.read_asset(tmp_path / "asset").textures[0].component("reflection").weights, before, atol=0.15
    )


def test_textures_are_read_one_after_another(tmp_path) -> None:
    asset(tmp_path / "asset")
    whole = ibrpipe.read_asset(tmp_path / "asset")
    (texture,) = ibrpipe.read_textures(tmp_path / "asset")
    np.testing.assert_array_equal(texture.layers.color, whole.textures[0].layers.color)
    np.testing.assert_array_equal(
        texture.component("reflection").weights, whole.textures[0].component("reflection").weights
    )
    assert list(ibrpipe.read_textures(tmp_path / "asset", [])) == []
    assert len(list(ibrpipe.read_textures(tmp_path / "asset", ["texture_00"]))) == 1
    with pytest.raises(ValueRangeError, match="no texture is called 'roof'; there are texture_00"):
        ibrpipe.read_textures(tmp_path / "asset", ["roof"])


def test_damage_is_told(tmp_path) -> None:
    asset(tmp_path / "asset")
    file = tmp_path / "asset/texture_00/reflection_weights.avif"
    data = file.read_bytes()
    for damaged in (b"", data[:50], b"\0" * len(data)):
        file.write_bytes(damaged)
        with pytest.raises(FormatError, match=r"weights.avif: .*copy the asset again"):
            ibrpipe.read_asset(tmp_path / "asset")
    file.unlink()
    with pytest.raises(MissingFileError, match="weights"):
        ibrpipe.read_asset(tmp_path / "asset")
    file.write_bytes(data)
    index = tmp_path / "asset/asset.json"
    text = index.read_text()
    start = text.index('"tops"', text.index('"textures"'))
    end = text.index("]", start)
    index.write_text(text[:start] + '"tops": [1.0' + text[end:])
    with pytest.raises(FormatError, match="1 tops of weights for 2 tables"):
        ibrpipe.read_asset(tmp_path / "asset")
