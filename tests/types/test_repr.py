"""Assets and frames are told in one short line."""

from __future__ import annotations

import numpy as np

from ibrpipe.types import Asset, Frame


def test_frame_says_its_size_and_what_it_holds() -> None:
    frame = Frame(np.zeros((480, 640, 3), np.float32), None, np.zeros((480, 640), np.float32))
    assert repr(frame) == "Frame(640 x 480: color, alpha)"
    assert repr(Frame(None, None, None)) == "Frame(empty)"


def test_asset_without_textures() -> None:
    assert repr(Asset(())) == "Asset(0 textures, view dependence: none)"


def test_channels_of_a_file_are_those_there_are_and_colour_is_times_alpha() -> None:
    color, alpha, depth = np.full((2, 3, 3), (0.2, 0.4, 0.8), np.float32), np.full((2, 3), 0.5), np.full((2, 3), 7.0)
    found = Frame(color, depth, alpha).channels
    assert {name: plane[1, 2] for name, plane in found.items()} == {
        "R": np.float32(0.1), "G": np.float32(0.2), "B": np.float32(0.4), "A": 0.5, "Z": 7.0,
    }  # fmt: skip
    assert list(Frame(None, depth, None).channels) == ["Z"]
    np.testing.assert_array_equal(Frame(color, None, None).channels["B"], color[..., 2])
