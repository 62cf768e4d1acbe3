"""Middlebury stereo folders as captures, their truth, and depth maps measured against it."""

import json

import numpy as np
import pytest
from click.testing import CliRunner

from ibrpipe.cli.main import cli
from ibrpipe.errors import CaptureError, FormatError, MissingFileError
from ibrpipe.evaluation.depth_error import disparity_error
from ibrpipe.io.cameras.middlebury import read_calibration, read_disparity, read_pfm
from ibrpipe.io.captures import has_cameras, read_capture
from ibrpipe.io.dense import Workspace, write_map
from ibrpipe.io.photos.images import write_png

CALIB = """cam0=[100.5 0 15.25; 0 100.5 11; 0 0 1]
cam1=[100.5 0 18.25; 0 100.5 11; 0 0 1]
doffs=3
baseline=20
width=32
height=24
ndisp=16
"""


def write_pfm(path, pixels, order="<"):
    head = f"Pf\n{pixels.shape[1]} {pixels.shape[0]}\n{-1.0 if order == '<' else 1.0}\n"
    path.write_bytes(head.encode() + pixels[::-1].astype(f"{order}f4").tobytes())


@pytest.fixture
def truth():
    y, x = np.mgrid[:24, :32]
    return np.where(x + y > 3, 5 + 0.1 * x + 0.05 * y, np.inf)


@pytest.fixture
def pair(tmp_path, truth):
    (tmp_path / "calib.txt").write_text(CALIB)
    for name in ("im0.png", "im1.png"):
        write_png(tmp_path / name, np.full((24, 32, 3), 0.5, np.float32))
    write_pfm(tmp_path / "disp0.pfm", truth)
    return tmp_path


def test_a_pair_is_a_capture_with_the_geometry_of_its_disparity(pair):
    assert has_cameras(pair)
    left, right = read_capture(pair).train
    assert (left.name, right.name) == ("im0", "im1")
    assert left.camera.K[:2, 2].tolist() == [15.75, 11.5]
    depth, pixel = 300.0, np.array([12.5, 9.5, 1.0])
    there = right.camera.K @ (np.linalg.inv(left.camera.K) @ pixel * depth + right.camera.t)
    moved = pixel[0] - there[0] / there[2]
    assert moved == pytest.approx(read_calibration(pair / "calib.txt").disparity(np.array([depth]))[0])
    assert there[1] / there[2] == pytest.approx(9.5)


@pytest.mark.parametrize("order", ["<", ">"])
def test_float_maps_of_both_byte_orders(tmp_path, truth, order):
    write_pfm(tmp_path / "a.pfm", truth, order)
    assert np.array_equal(read_pfm(tmp_path / "a.pfm"), truth.astype(np.float32))


def test_disparity_as_numpy(tmp_path, truth):
    np.savez(tmp_path / "disp_left.npz", disp=truth)
    found = read_disparity(tmp_path)
    assert np.isnan(found[0, 0])
    assert np.array_equal(np.isfinite(found), np.isfinite(truth))


def test_shares_are_counted(pair, truth):
    calibration = read_calibration(pair / "calib.txt")
    wrong = truth + np.where(np.arange(32) < 8, 3.0, 0.25)
    depth = np.where(np.isfinite(wrong), 100.5 * 20 / (wrong + 3), 50.0)
    depth[:, 24:] = 0
    error = disparity_error(depth, calibration, read_disparity(pair), (1.0, 2.0, 4.0))
    there = np.isfinite(truth)
    assert error.pixels == there.sum()
    assert error.known == pytest.approx(there[:, :24].sum() / there.sum())
    assert error.bad == pytest.approx((there[:, :8].sum() / there[:, :24].sum(),) * 2 + (0,))
    assert error.bad_or_unknown[0] == pytest.approx((there[:, :8].sum() + 8 * 24) / there.sum())
    assert error.median == pytest.approx(0.25, abs=1e-5)
    with pytest.raises(CaptureError, match=r"is 16 x 24.*calib.txt says 32 x 24"):
        disparity_error(depth[:, :16], calibration, read_disparity(pair), (1.0,))
    with pytest.raises(CaptureError, match="no pixel has both"):
        disparity_error(0 * depth, calibration, read_disparity(pair), (1.0,))


def test_the_command(pair, truth, tmp_path):
    space = Workspace(tmp_path / "dense")
    space.lay_out()
    depth = np.where(np.isfinite(truth), 100.5 * 20 / (np.where(np.isfinite(truth), truth, 0) + 3), 0)
    write_map(space.depth("im0"), depth)
    run = CliRunner().invoke(cli, ["compare-depth", str(space.root), str(pair), "--json"])
    assert json.loads(run.output)["bad_or_unknown"] == [0, 0, 0, 0]
    run = CliRunner().invoke(cli, ["compare-depth", str(space.root), str(pair), "--view", "im0"])
    assert "bad-2  0.0 % of those with depth" in run.output
    assert CliRunner().invoke(cli, ["compare-depth", str(pair), str(pair)]).exit_code == 1


@pytest.mark.parametrize(("text", "message"), [("baseline=x", "baseline"), ("", "cam0"), ("cam0=[1 2; 3]", "cam0|1 2")])
def test_a_broken_calibration_is_told(tmp_path, text, message):
    (tmp_path / "calib.txt").write_text((CALIB if "baseline" in text else "") + text)
    with pytest.raises(FormatError, match=message):
        read_calibration(tmp_path / "calib.txt")


def test_missing_and_broken_truth_is_told(tmp_path):
    with pytest.raises(MissingFileError, match="holds no true disparity"):
        read_disparity(tmp_path)
    (tmp_path / "disp0.pfm").write_bytes(b"Pf\n4 4\n-1\n123")
    with pytest.raises(FormatError, match="cut off"):
        read_disparity(tmp_path)
    (tmp_path / "disp0.pfm").write_bytes(b"PF\n4 4\n-1\n123")
    with pytest.raises(FormatError, match="no grey portable float map"):
        read_disparity(tmp_path)
    with pytest.raises(MissingFileError, match=r"calib\.txt: does not exist"):
        read_calibration(tmp_path / "calib.txt")
