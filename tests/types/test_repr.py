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
