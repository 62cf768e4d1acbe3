"""Scores against values worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest

from ibrpipe.core.psnr import PSNR_CAP
from ibrpipe.errors import ShapeError
from ibrpipe.evaluation import image_scores
from ibrpipe.evaluation.metrics import Scores, mean_scores
from ibrpipe.types import Frame

EVERYWHERE = np.ones((40, 50), bool)


def flat(value, shape=(40, 50)):
    return np.full((*shape, 3), value, np.uint8)


@pytest.fixture
def textured():
    return np.random.default_rng(3).integers(40, 216, (40, 50, 3)).astype(np.uint8)


def test_codes_of_known_light():
    light = np.array([[[0.0, 1.0, 0.5], [0.0031308, 0.2140411, 4.0]]])
    assert image_scores.to_srgb8(light).tolist() == [[[0, 255, 188], [10, 127, 255]]]


def test_psnr_of_a_constant_difference():
    assert image_scores.psnr(flat(100), flat(110), EVERYWHERE) == pytest.approx(20 * np.log10(255 / 10))


def test_psnr_is_about_what_the_noise_says_neither_better_nor_worse():
    noise = np.random.default_rng(1).normal(0.0, 8.0, (200, 200, 3))
    noisy = np.rint(128 + noise).astype(np.uint8)
    found = image_scores.psnr(flat(128, (200, 200)), noisy, np.ones((200, 200), bool))
    expected = 20 * np.log10(255 / np.sqrt(8.0**2 + 1 / 12))
    assert expected - 0.1 < found < expected + 0.1


def test_equal_pictures(textured):
    assert image_scores.psnr(textured, textured, EVERYWHERE) == PSNR_CAP
    assert image_scores.ssim(textured, textured, EVERYWHERE) == pytest.approx(1.0, abs=1e-12)
    assert image_scores.flip(textured, textured, EVERYWHERE) == 0.0


def test_ssim_of_flat_pictures_is_its_luminance_term():
    c1 = (0.01 * 255) ** 2
    expected = (2 * 100 * 140 + c1) / (100**2 + 140**2 + c1)
    assert image_scores.ssim(flat(100), flat(140), EVERYWHERE) == pytest.approx(expected, abs=1e-9)


def test_ssim_of_a_window_by_hand(textured):
    other = np.clip(textured.astype(int) + np.random.default_rng(4).integers(-40, 40, textured.shape), 0, 255)
    other = other.astype(np.uint8)
    only = np.zeros_like(EVERYWHERE)
    only[17:24, 27:34] = True  # the window around (20, 30) lies inside
    found = image_scores.ssim(textured, other, only)
    x, y = textured.astype(float), other.astype(float)
    x[~only], y[~only] = 0.0, 0.0
    by_hand = [_ssim_at(x, y, row, column, c) for row in range(17, 24) for column in range(27, 34) for c in range(3)]
    assert found == pytest.approx(np.mean(by_hand), abs=1e-9)


def _ssim_at(x, y, row, column, channel):
    """Wang et al. 2004, equation 13, uniform 7 x 7 window, sample covariance."""
    window = np.s_[row - 3 : row + 4, column - 3 : column + 4, channel]
    a, b = x[window].ravel(), y[window].ravel()
    c1, c2 = (0.01 * 255) ** 2, (0.03 * 255) ** 2
    covariance = np.cov(a, b)
    above = (2 * a.mean() * b.mean() + c1) * (2 * covariance[0, 1] + c2)
    return above / ((a.mean() ** 2 + b.mean() ** 2 + c1) * (covariance[0, 0] + covariance[1, 1] + c2))


def test_flip_grows_with_the_difference(textured):
    near = image_scores.flip(textured, (textured + 5).astype(np.uint8), EVERYWHERE)
    far = image_scores.flip(textured, (textured + 30).astype(np.uint8), EVERYWHERE)
    assert 0.0 < near < far < 1.0


@pytest.mark.parametrize("score", [image_scores.psnr, image_scores.ssim, image_scores.flip])
def test_what_lies_outside_the_mask_counts_nothing(textured, score):
    mask = EVERYWHERE.copy()
    mask[:, :25] = False
    other = (textured // 2).astype(np.uint8)
    spoilt = other.copy()
    spoilt[:, :25] = 255
    assert score(textured, spoilt, mask) == score(textured, other, mask)
    assert score(textured, spoilt, EVERYWHERE) != score(textured, other, EVERYWHERE)


@pytest.mark.parametrize("score", [image_scores.psnr, image_scores.ssim, image_scores.flip])
def test_an_empty_mask_has_no_score(textured, score):
    assert score(textured, textured, ~EVERYWHERE) is None


@pytest.mark.parametrize("corner", [(0, 0), (39, 0), (0, 49), (39, 49)])
def test_ssim_of_one_pixel_in_a_corner(textured, corner):
    mask = ~EVERYWHERE
    mask[corner] = True
    assert image_scores.ssim(textured, textured, mask) == pytest.approx(1.0)


def test_ssim_of_a_tiny_picture_is_refused():
    small = np.ones((6, 50), bool)
    with pytest.raises(ShapeError, match="at least 7 pixels a side, got"):
        image_scores.ssim(flat(1, (6, 50)), flat(2, (6, 50)), small)


def test_depth_error_over_pixels_that_both_hit():
    truth = np.array([[1.0, 2.0, np.inf, 4.0, 5.0]], np.float32)
    depth = np.array([[1.3, 2.4, 3.0, np.inf, 9.0]], np.float32)
    mask = np.array([[True, True, True, True, False]])
    rmse, median = image_scores.depth_errors(truth, depth, mask)
    assert rmse == pytest.approx(np.sqrt((0.3**2 + 0.4**2) / 2), rel=1e-6)
    assert median == pytest.approx(0.35, rel=1e-6)
    assert image_scores.depth_errors(truth, np.full_like(truth, np.inf), mask) == (None, None)


def test_coverage_counts_mask_pixels_alone():
    alpha = np.array([[1.0, 0.0, 1.0, 1.0, 1.0]])
    mask = np.array([[True, True, True, False, False]])
    assert image_scores.coverage(alpha, mask) == pytest.approx(2 / 3)


def test_highlights_are_patches_not_lines():
    diffuse, truth = flat(100), flat(100)
    truth[5:10, 5:10, 1] = 124  # a patch, in one channel
    truth[20, 5:40] = 200  # a thin line
    truth[30:35, 30:35] = 123  # not far enough
    truth[12:17, 40:45] = 60  # darker counts too
    found = image_scores.highlight_pixels(truth, diffuse, EVERYWHERE, 24)
    expected = ~EVERYWHERE
    expected[5:10, 5:10] = True
    expected[12:17, 40:45] = True
    assert (found == expected).all()


def test_a_frame_is_scored_with_uncovered_pixels_black():
    mask = ~EVERYWHERE
    mask[10:30, 10:30] = True
    truth = image_scores.Truth(flat(188), mask, np.full((40, 50), 2.0, np.float32))
    color, alpha = np.full((40, 50, 3), 0.5, np.float32), np.ones((40, 50), np.float32)
    color[10:20], alpha[10:20] = 0.0, 0.0
    depth = np.where(alpha > 0, np.float32(2.5), np.float32(np.inf))
    highlights = mask.copy()
    highlights[20:30] = False
    found = image_scores.score_frame(truth, Frame(color, depth, alpha), highlights)
    assert found.psnr == pytest.approx(10 * np.log10(255**2 / (188**2 / 2)))
    assert found.coverage == 0.5
    assert found.depth_rmse == pytest.approx(0.5)
    assert found.psnr_highlight == pytest.approx(20 * np.log10(255 / 188))
    assert found.psnr_rest == PSNR_CAP
    assert found.psnr_covered is None
    covered = image_scores.covered_pixels([Frame(color, depth, alpha), Frame(color, depth, None)], mask)
    assert (covered == (mask & (alpha > 0))).all()
    inside = image_scores.score_frame(truth, Frame(color, depth, alpha), mask & ~mask, covered)
    assert (inside.psnr, inside.psnr_covered) == (found.psnr, PSNR_CAP)
    assert (inside.ssim_covered, inside.flip_covered) == (pytest.approx(1), pytest.approx(0, abs=1e-6))
    assert inside.psnr_rest == PSNR_CAP  # what is not covered is no part of it


@pytest.mark.parametrize("corner", [(90, 100), (0, 0), (170, 215)])
def test_flip_of_the_surroundings_is_flip_of_the_whole(corner):
    random = np.random.default_rng(3)
    truth, picture = (random.integers(0, 256, (200, 240, 3)).astype(np.uint8) for _ in range(2))
    mask = np.zeros((200, 240), bool)
    mask[corner[0] : corner[0] + 30, corner[1] : corner[1] + 25] = True
    whole = image_scores.flip_map(truth, picture, mask)[mask]
    assert image_scores.flip(truth, picture, mask) == whole.mean(dtype=np.float64)


def test_figures_of_a_fully_covered_mask_are_told_twice_alike():
    truth = image_scores.Truth(flat(188), EVERYWHERE)
    frame = Frame(np.full((40, 50, 3), 0.4, np.float32), None, None)
    found = image_scores.score_frame(truth, frame, None, EVERYWHERE)
    assert (found.psnr, found.ssim, found.flip) == (found.psnr_covered, found.ssim_covered, found.flip_covered)


def test_a_frame_of_another_size_is_refused():
    truth = image_scores.Truth(flat(1), EVERYWHERE)
    with pytest.raises(ShapeError, match=r"\(20, 50, 3\) but the held-out photo is \(40, 50, 3\)"):
        image_scores.score_frame(truth, Frame(np.zeros((20, 50, 3), np.float32), None, None))


@pytest.mark.parametrize(
    ("color", "mask", "depth", "words"),
    [
        (np.zeros((4, 4, 3)), np.ones((4, 4), bool), None, "uint8"),
        (np.zeros((4, 4, 3), np.uint8), np.ones((4, 5), bool), None, r"mask must be \(4, 4\)"),
        (np.zeros((4, 4, 3), np.uint8), np.ones((4, 4), bool), np.zeros((3, 4)), r"depth must be \(4, 4\)"),
    ],
)
def test_a_truth_of_wrong_shape_is_refused(color, mask, depth, words):
    with pytest.raises(ShapeError, match=words):
        image_scores.Truth(color, mask, depth)


def test_means_leave_out_views_without_the_figure():
    one = Scores(psnr=20.0, ssim=0.5, flip=0.2, coverage=1.0, depth_rmse=0.1)
    two = Scores(psnr=30.0, ssim=0.7, flip=0.1, coverage=0.5)
    found = mean_scores([one, two])
    assert (found.psnr, found.coverage, found.depth_rmse, found.psnr_highlight) == (25.0, 0.75, 0.1, None)
