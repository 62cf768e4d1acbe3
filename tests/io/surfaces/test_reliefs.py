"""Relief textures on disk: colour and quantised displacement in one image, continuous where the source is."""

from __future__ import annotations

import json

import cv2
import numpy as np
import pytest
from click.testing import CliRunner

import ibrpipe
from ibrpipe.cli.main import cli
from ibrpipe.errors import FormatError, MissingFileError, ResourceError, ValueRangeError
from ibrpipe.io.photos.images import read_image
from ibrpipe.io.surfaces.reliefs import is_reliefs, quantized
from ibrpipe.types import LayeredDepthImage


def relief(size=24, jump=0.0):
    rng = np.random.default_rng(4)
    y, x = np.mgrid[:size, :size] / size
    height = 0.3 * np.sin(4 * x) * np.cos(3 * y) + jump * (x > 0.5)
    height[3:6, 7:9] = np.nan
    frame = ibrpipe.ParallelFrame((-1, 0.5, 2), (0.04, 0, 0.01), (0, -0.05, 0), (0, 0, 1))
    return ibrpipe.ReliefTexture(frame, rng.random((size, size, 3)), height)


@pytest.mark.parametrize("bits", [8, 16, "float"])
def test_what_is_written_is_read(bits, tmp_path):
    one, other = relief(), relief(16)
    ibrpipe.write_reliefs([one, other], tmp_path / "r", ["one", "other"], bits=bits)
    found = ibrpipe.read_reliefs(tmp_path / "r")
    for before, after in zip((one, other), found, strict=True):
        span = np.nanmax(before.height) - np.nanmin(before.height)
        least = {8: span / 254 / 2.01, 16: span / 65534 / 2.01, "float": 0.0}[bits]
        error = np.abs(after.height - before.height)
        np.testing.assert_array_equal(np.isnan(after.height), np.isnan(before.height))
        assert np.nanmax(error) <= 1.02 * least + 1e-7
        assert np.nanmax(error) >= 0.7 * least - 1e-7
        np.testing.assert_array_equal(after.frame.origin, before.frame.origin)
        np.testing.assert_array_equal(after.frame.a, before.frame.a)
        tolerance = {8: 0.0045, 16: 2e-5, "float": 0.0}[bits]
        assert np.abs(after.color - before.color).max() <= tolerance
    assert [each.suffix for each in sorted((tmp_path / "r").glob("relief_*"))] == [
        ".exr" if bits == "float" else ".png"
    ] * 2


@pytest.mark.parametrize("bits", [8, 16])
def test_indices_are_the_papers(bits):
    height = np.array([[1.0, 3.0, np.nan], [1.5, 2.0, 2.999]])
    codes, low, step = quantized(height, bits)
    most = 2**bits - 1
    assert (low, step) == (1.0, pytest.approx(2.0 / (most - 1)))
    assert codes.tolist() == [[0, most - 1, most], [round(0.25 * (most - 1)), round(0.5 * (most - 1)),
                                                    round(0.9995 * (most - 1))]]  # fmt: skip
    level, _, one = quantized(np.full((2, 2), 7.0), bits)
    assert (level.max(), one) == (0, 1.0)


def test_one_image_holds_colour_and_displacement(tmp_path):
    ibrpipe.write_reliefs([relief()], tmp_path / "r", bits=8)
    pixels = cv2.imread(str(tmp_path / "r/relief_00.png"), cv2.IMREAD_UNCHANGED)
    assert (pixels.shape, pixels.dtype) == ((24, 24, 4), np.uint8)
    entry = json.loads((tmp_path / "r/reliefs.json").read_text())["reliefs"][0]
    heights = np.where(pixels[..., 3] == 255, np.nan, entry["low"] + entry["step"] * pixels[..., 3])
    np.testing.assert_allclose(heights, relief().height, atol=0.51 * entry["step"])


def test_neighbours_are_parted_only_where_that_was_asked_for(tmp_path):
    source = relief(jump=2.0)
    for name, joined in (("joined", True), ("parted", False)):
        ibrpipe.write_reliefs([source], tmp_path / name, bits="float", joined=joined)
    joined, parted = (ibrpipe.read_reliefs(tmp_path / name)[0] for name in ("joined", "parted"))
    np.testing.assert_array_equal(joined.height, source.height)
    assert isinstance(parted.layers, LayeredDepthImage)
    view = ibrpipe.Camera.look_at((-5, -0.3, 5), (-0.5, 0, 3), fov_y_deg=30, width=90, height=70)
    cover = {name: ibrpipe.render(each, view, "ldi").alpha.sum() for name, each in (("j", joined), ("p", parted))}
    assert cover["j"] > 1.1 * cover["p"] > 100


def test_a_folder_of_relief_textures_is_also_an_asset(tmp_path):
    ibrpipe.write_reliefs([relief()], tmp_path / "r", ["wall"], bits="float")
    asset = ibrpipe.read_asset(tmp_path / "r")
    assert asset.info["textures"][0]["name"] == "wall"
    assert len(asset.textures[0].layers.depth) == np.isfinite(relief().height).sum()


def test_what_is_wrong_is_told(tmp_path):
    with pytest.raises(ValueRangeError, match="no relief textures"):
        ibrpipe.write_reliefs([], tmp_path / "r")
    with pytest.raises(ValueRangeError, match="bits is 12"):
        ibrpipe.write_reliefs([relief()], tmp_path / "r", bits=12)
    (tmp_path / "full").mkdir()
    (tmp_path / "full/note.txt").write_text("mine")
    with pytest.raises(ResourceError, match="holds files but no relief textures"):
        ibrpipe.write_reliefs([relief()], tmp_path / "full")
    with pytest.raises(MissingFileError, match=r"reliefs\.json"):
        ibrpipe.read_reliefs(tmp_path / "none")
    ibrpipe.write_reliefs([relief()], tmp_path / "r", bits=8)
    assert is_reliefs(tmp_path / "r")
    index = tmp_path / "r/reliefs.json"
    before = index.read_text()
    for change, told in (
        (lambda entry: entry.update(step=0), "step"),
        (lambda entry: entry.update(file="../x.png"), "leads out"),
        (lambda entry: entry["frame"].update(f=[0, 0, 2]), "relief_00"),
        (lambda entry: entry.update(file="none.png"), r"none\.png"),
    ):
        document = json.loads(before)
        change(document["reliefs"][0])
        index.write_text(json.dumps(document))
        with pytest.raises((FormatError, MissingFileError), match=told):
            ibrpipe.read_reliefs(tmp_path / "r")
    index.write_text(before)
    cv2.imwrite(str(tmp_path / "r/relief_00.png"), np.zeros((4, 4, 3), np.uint8))
    with pytest.raises(FormatError, match="has colours and displacements"):
        ibrpipe.read_reliefs(tmp_path / "r")


def call(*words):
    return CliRunner().invoke(cli, [str(word) for word in words], catch_exceptions=False)


def test_the_command_line_keeps_a_rock_whole(tmp_path):
    (tmp_path / "rock").mkdir()
    codes = np.zeros((40, 40), np.uint8)
    codes[10:30, 10:30] = 255
    cv2.imwrite(str(tmp_path / "rock/height.png"), codes)
    cv2.imwrite(str(tmp_path / "rock/color.png"), np.full((40, 40, 3), 200, np.uint8))
    made = call("relief", "images", tmp_path / "rock", "--depth-range", 0, 0.5, "--out", tmp_path / "whole")
    assert "joined all the same; --part parts them" in made.output
    call(
        "relief", "images", tmp_path / "rock", "--depth-range", 0, 0.5, "--part", "--bits", 8, "--out", tmp_path / "cut"
    )
    shares = {}
    for name in ("whole", "cut"):
        words = ("--renderers", "ldi", "--path", "orbit:frames=1,width=80,height=60,up=y,azimuth=30,elevation=35")
        done = call("render", "--asset", tmp_path / name, *words, "--repeats", 1, "--out", tmp_path / f"f_{name}")
        assert done.exit_code == 0, done.output
        shares[name] = read_image(next((tmp_path / f"f_{name}").glob("render*/ldi/*.exr")))[..., 3].mean()
    assert shares["whole"] > 1.1 * shares["cut"] > 0.05
    facts = json.loads(call("inspect", tmp_path / "cut", "--json").output)
    assert (facts["kind"], facts["textures"]["front"]["joined"]) == ("relief textures", False)
    assert call("relief", "asset", tmp_path / "whole", "--out", tmp_path / "asset").exit_code == 0
    assert ibrpipe.read_asset(tmp_path / "asset").textures[0].layers.shape == (40, 40)
