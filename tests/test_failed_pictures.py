"""What a failing picture test leaves behind."""

from __future__ import annotations

import cv2
import failed_pictures
import numpy as np
import pytest

import ibrpipe


def scopes_of(excinfo: pytest.ExceptionInfo) -> list:
    return [entry.frame.f_locals for entry in reversed(excinfo.traceback)]


def test_a_failed_comparison_of_arrays_is_written(tmp_path):
    wanted = np.linspace(0, 1, 48).reshape(6, 8)
    got = wanted.copy()
    got[2, 5] += 0.5
    with pytest.raises(AssertionError) as error:
        np.testing.assert_allclose(got, wanted, atol=0.1)
    files = failed_pictures.write_pictures(scopes_of(error), tmp_path)
    assert [path.name for path in files] == ["got.png", "wanted.png", "difference.png"]
    difference = cv2.imread(str(files[2]), cv2.IMREAD_GRAYSCALE)
    assert difference[2, 5] == 255
    assert np.count_nonzero(difference) == 1


def test_frames_are_written_part_by_part(tmp_path):
    depth = np.full((5, 7), np.inf, np.float32)
    got = ibrpipe.Frame(np.zeros((5, 7, 3), np.float32), depth, None)
    want = ibrpipe.Frame(np.ones((5, 7, 3), np.float32), np.where(np.eye(5, 7) > 0, 2.0, depth), None)
    with pytest.raises(AssertionError) as error:
        assert (got.color == want.color).all()
    names = {path.name for path in failed_pictures.write_pictures(scopes_of(error), tmp_path)}
    assert names == {f"{part}-{kind}.png" for part in ("color", "depth") for kind in ("got", "wanted", "difference")}


def test_figures_are_no_pictures(tmp_path):
    with pytest.raises(AssertionError) as error:
        np.testing.assert_allclose(np.arange(3.0), np.ones(3))
    assert failed_pictures.write_pictures(scopes_of(error), tmp_path / "none") == []
    assert not (tmp_path / "none").exists()
