"""Frames on disk: what is covered in part comes back as it was rendered."""

from __future__ import annotations

import numpy as np

from ibrpipe.io.frames import write_frame
from ibrpipe.io.photos.images import read_depth, read_image
from ibrpipe.types import Frame


def test_colours_and_coverage_come_back(tmp_path):
    random = np.random.default_rng(2)
    color, alpha = random.random((5, 7, 3)).astype(np.float32), random.integers(0, 5, (5, 7)).astype(np.float32) / 4
    color[alpha == 0] = 0
    (tmp_path / "ldi").mkdir()
    files = write_frame(Frame(color, np.ones((5, 7), np.float32), alpha, {}), tmp_path / "ldi" / "a")
    for name, tolerance in (("file", 1e-6), ("png", 0.01)):
        found = read_image(tmp_path / files[name])
        np.testing.assert_allclose(found[..., 3], alpha, atol=0.003)
        np.testing.assert_allclose(found[..., :3][alpha > 0], color[alpha > 0], atol=tolerance)
    assert (read_depth(tmp_path / files["file"]) == 1).all()


def test_colours_without_alpha_are_written_as_they_are(tmp_path):
    color = np.random.default_rng(3).random((4, 4, 3)).astype(np.float32)
    (tmp_path / "ldi").mkdir()
    files = write_frame(Frame(color, None, None, {}), tmp_path / "ldi" / "a")
    np.testing.assert_array_equal(read_image(tmp_path / files["file"])[..., :3], color)
