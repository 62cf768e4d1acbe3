"""What is packed into a page, and how its text is made safe."""

from __future__ import annotations

import base64
import json
import logging
import re
import zlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st
from page_assets import ball_layers, make_asset, seen_from_a_point

from ibrpipe.cli.main import cli
from ibrpipe.errors import ConfigError, FormatError, MissingFileError
from ibrpipe.export.page import exporter
from ibrpipe.export.page.components import ATLAS, place_images
from ibrpipe.export.page.notes import Annotation, PageNotes, read_notes
from ibrpipe.export.page.packing import Packer, foretell, neighbours
from ibrpipe.export.page.surface import depth_codes, octahedral_codes
from ibrpipe.io.assets import write_asset
from ibrpipe.types import Asset, Texture
from ibrpipe.types.bounds import sample_positions


@pytest.fixture
def quick_poster(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(exporter, "poster", lambda asset, start: b"RIFF")


def unpacked(packer: Packer) -> bytes:
    return zlib.decompress(base64.b64decode(packer.encoded()))


def read_back(data: bytes, entry: dict) -> np.ndarray:
    kind = np.dtype(entry["type"])
    raw = np.frombuffer(data, np.uint8, entry["length"] * kind.itemsize, entry["offset"])
    return raw.reshape(kind.itemsize, -1).T.copy().view(kind).ravel()


@pytest.mark.parametrize("kind", [np.uint8, np.uint16, np.int32, np.float32])
def test_arrays_come_back(kind: type) -> None:
    values = np.random.default_rng(0).integers(0, 200, 37).astype(kind)
    packer = Packer()
    packer.add(np.zeros(3, np.uint8))
    entry = packer.add(values)
    np.testing.assert_array_equal(read_back(unpacked(packer), entry), values)


@given(st.integers(1, 6), st.integers(1, 6), st.integers(0, 2**31))
def test_foretold_values_come_back_in_one_pass(rows: int, columns: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    counts = rng.integers(0, 3, (rows, columns))
    ends = np.cumsum(counts).reshape(rows, columns)
    offsets = np.concatenate([np.r_[0, ends[:-1, -1]][:, None], ends], axis=1)
    values = rng.integers(0, 256, counts.sum()).astype(np.uint8)
    around, packer = neighbours(offsets), Packer()
    entry = packer.add(values, foretell(values, around))
    folded = read_back(unpacked(packer), entry).astype(int)
    back = np.zeros(len(values), np.uint8)
    for s in range(len(values)):
        left, above, corner = around[:, s]
        assert max(left, above, corner) < s
        if left >= 0 and above >= 0:
            a, b = int(back[left]), int(back[above])
            c = int(back[corner]) if corner >= 0 else a
            guess = sorted((a, b, a + b - c))[1]
        else:
            guess = int(back[left if left >= 0 else above if above >= 0 else s - 1]) if s or left >= 0 else 0
        difference = -(folded[s] + 1) // 2 if folded[s] % 2 else folded[s] // 2
        back[s] = (guess + difference) % 256
    np.testing.assert_array_equal(back, values)


def test_depths_are_exact_or_in_65536_levels() -> None:
    few = np.float32([0.3, 0.1, 0.3])
    levels, codes = depth_codes(few)
    np.testing.assert_array_equal(levels[codes], few)
    many = np.random.default_rng(0).uniform(1, 3, 80_000).astype(np.float32)
    levels, codes = depth_codes(many)
    assert len(levels) == 65536
    assert abs(levels[codes] - many).max() < 0.6 * 2 / 65535


def test_normals_are_within_six_hundredths_of_a_degree() -> None:
    normals = np.random.default_rng(0).normal(size=(5000, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    normals[7] = np.nan
    u, v = octahedral_codes(normals)
    assert (u[7], v[7]) == (4095, 4095)
    e = np.stack([u, v], axis=1) * (2 / 4094) - 1
    z = 1 - abs(e).sum(axis=1)
    folded = np.where((z < 0)[:, None], (1 - abs(e[:, ::-1])) * np.where(e < 0, -1, 1), e)
    back = np.column_stack([folded, z])
    back /= np.linalg.norm(back, axis=1, keepdims=True)
    angles = np.degrees(np.arccos(np.clip((back * normals).sum(axis=1), -1, 1)))
    assert np.nanmax(angles) < 0.06


def test_samples_lie_on_the_ball() -> None:
    np.testing.assert_allclose(np.linalg.norm(sample_positions(seen_from_a_point()), axis=1), 1, atol=1e-5)
    places = sample_positions(ball_layers())
    ball = places[:, 2] > -1.1
    np.testing.assert_allclose(np.linalg.norm(places[ball], axis=1), 1, atol=1e-5)


def test_residual_images_do_not_overlap() -> None:
    sizes = np.random.default_rng(0).integers(1, 700, (60, 2))
    pages, places = place_images(sizes)
    taken = np.zeros((pages, ATLAS, ATLAS), np.uint8)
    for (page, y, x), (height, width) in zip(places, sizes, strict=True):
        taken[page, y : y + height, x : x + width] += 1
    assert taken.max() == 1
    assert taken.sum() == sizes.prod(axis=1).sum()
    with pytest.raises(FormatError, match="lower residual_scale"):
        place_images(np.array([[ATLAS + 1, 4]]))


@pytest.mark.usefixtures("quick_poster")
def test_words_are_escaped_and_the_policy_names_the_script() -> None:
    evil = "</script><img src=x onerror=alert(1)>"
    notes = PageNotes(title=evil, credit=evil, annotations=(Annotation(at=(0, 0, 0), text=evil),))
    text = exporter.make_page(make_asset("matt"), notes, "name").text
    assert "<img src=x" not in text
    assert text.count("</script>") == 3
    assert json.loads(re.search(r'id="meta">(.*?)</script>', text)[1])["notes"][0]["text"] == evil
    policy = re.search(r'http-equiv="Content-Security-Policy" content="([^"]*)"', text)[1]
    assert policy.startswith("default-src &#39;none&#39;; script-src &#39;sha256-")
    assert "unsafe" not in policy
    assert re.findall(r"https?://", text) == []


@pytest.mark.usefixtures("quick_poster")
def test_unknown_kinds_are_told(caplog: pytest.LogCaptureFixture) -> None:
    @dataclass(frozen=True)
    class Tint:
        kind = "tint"
        bytes = 0
        shared = None

        def of_samples(self, kept: object) -> Tint:
            raise NotImplementedError

        def predicting(self) -> Tint:
            raise NotImplementedError

    with caplog.at_level(logging.WARNING):
        exporter.make_page(Asset((Texture(ball_layers(), (Tint(),)),)), PageNotes(), "name")
    assert [each.message for each in caplog.records] == [
        'view dependence of kind "tint" is left out: pages know reflection, spiral, photos'
    ]


@pytest.mark.usefixtures("quick_poster")
def test_the_command_writes_a_page_with_notes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(exporter, "LARGE", 1000)
    write_asset(make_asset("matt"), tmp_path / "run/asset")
    (tmp_path / "notes.yaml").write_text("title: A ball\nlicense: CC0\n")
    arguments = ["export", str(tmp_path / "run"), str(tmp_path / "a.html")]
    result = CliRunner().invoke(cli, [*arguments, "--notes", str(tmp_path / "notes.yaml")])
    assert result.exit_code == 0, result.output
    text = (tmp_path / "a.html").read_text()
    assert "<h1>A ball</h1>" in text
    assert "CC0" in text
    assert CliRunner().invoke(cli, arguments).exit_code == 0
    assert "<h1>run</h1>" in (tmp_path / "a.html").read_text()
    refused = CliRunner().invoke(cli, ["export", str(tmp_path / "run"), str(tmp_path / "d"), "--format", "deep-exr",
                                       "--notes", str(tmp_path / "notes.yaml")])  # fmt: skip
    assert "has no place for notes" in refused.stderr


@pytest.mark.usefixtures("quick_poster")
def test_large_pages_are_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(exporter, "LARGE", 1000)
    write_asset(make_asset("matt"), tmp_path / "asset")
    with caplog.at_level(logging.WARNING):
        exporter.write(tmp_path / "asset", tmp_path / "a.html")
    assert "phones may refuse: a lower plan.oversampling" in caplog.text


def test_wrong_notes_name_the_line(tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_text("title: x\nannotation: []\n")
    with pytest.raises(ConfigError, match=r"a\.yaml:2.*annotations"):
        read_notes(tmp_path / "a.yaml")
    with pytest.raises(MissingFileError, match="no such file"):
        read_notes(tmp_path / "b.yaml")
    (tmp_path / "c.yaml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(FormatError, match="UTF-8"):
        read_notes(tmp_path / "c.yaml")


def test_an_empty_asset_is_refused() -> None:
    with pytest.raises(FormatError, match="holds no sample"):
        exporter.make_page(Asset(()), PageNotes(), "name")
