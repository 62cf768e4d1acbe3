"""Frames of videos that serve as photos: sharp, bright, and evenly spread along the camera's way."""

from __future__ import annotations

import numpy as np
import pytest

from ibrpipe.capture.video_frames import LEAST_STEP, FrameFigures, choose_frames, measure_frames


def figures(motion: np.ndarray, **changes: dict[int, float]) -> FrameFigures:
    """All frames alike but for `changes` of sharpness and brightness by frame."""
    columns = {"sharpness": np.full(len(motion), 1.0), "bright": np.full(len(motion), 0.8)}
    for name, values in changes.items():
        for frame, value in values.items():
            columns[name][frame] = value
    return FrameFigures(motion=motion.astype(float), **columns)


def test_every_step_of_the_way_gives_its_sharpest_frame() -> None:
    # 4 steps of 10 frames; the way starts with the first frame, so a step's last frame belongs to the next
    chosen = choose_frames(figures(np.full(40, 0.02), sharpness={3: 1.2, 17: 1.3, 25: 1.2, 38: 1.1}), 4)
    assert chosen.frames == (3, 17, 25, 38)
    assert chosen.told(4) == "4 of 40 frames are taken, the sharpest of every step of the camera"


def test_a_camera_that_rests_does_not_crowd_the_photos() -> None:
    motion = np.concatenate([np.full(20, 0.03), np.zeros(100), np.full(20, 0.03)])
    frames = np.array(choose_frames(figures(motion), 12).frames)
    assert len(frames) == 12
    assert np.count_nonzero((frames >= 20) & (frames < 120)) <= 1  # resting, all are one place
    assert abs(np.count_nonzero(frames < 20) - np.count_nonzero(frames >= 120)) <= 1


def test_dark_and_blurred_frames_are_left_out_and_counted() -> None:
    blurred, dark = dict.fromkeys(range(2, 40, 5), 0.3), {10: 0.05, 11: 0.05}
    chosen = choose_frames(figures(np.full(40, 0.02), sharpness=blurred, bright=dark), 30)
    assert not set(chosen.frames) & {*blurred, *dark}
    assert (chosen.blurred, chosen.dark) == (8, 2)
    assert "2 too dark and 8 blurred left out" in chosen.told(30)
    assert len(chosen.frames) == 30  # of the 30 that are left: steps without a sharp frame are made up for


def test_less_than_a_least_step_apart_is_no_new_photo() -> None:
    chosen = choose_frames(figures(np.full(101, LEAST_STEP / 10)), 50)
    assert len(chosen.frames) == 11  # a way of ten least steps
    assert "moves too little for 50 different photos" in chosen.told(50)


def test_where_nothing_can_be_followed_frames_are_taken_evenly() -> None:
    frames = choose_frames(figures(np.full(60, np.nan)), 6).frames
    assert np.diff(frames).tolist() == pytest.approx([10] * 5, abs=1)


def test_nothing_but_darkness_gives_nothing() -> None:
    dark = choose_frames(figures(np.full(5, np.nan), bright=dict.fromkeys(range(5), 0.0)), 3)
    assert (dark.frames, dark.dark) == ((), 5)


def test_motion_sharpness_and_brightness_are_measured() -> None:
    rough = np.random.default_rng(3).integers(40, 220, (30, 50, 3), np.uint8).repeat(8, 0).repeat(8, 1)

    def window(left: int) -> np.ndarray:
        return np.ascontiguousarray(rough[:, left : left + 320])

    measured = measure_frames([window(0), window(4), window(12), window(12) // 16])
    # 4 and 8 pixels of 320, to the tenth of a pixel that following features is good for
    assert measured.motion[1:3] == pytest.approx([4 / 320, 8 / 320], abs=0.1 / 320)
    assert np.isnan(measured.motion[0])
    assert measured.sharpness[1] == pytest.approx(measured.sharpness[0], rel=0.2)
    assert measured.bright[2] > 0.7 > 0.12 > measured.bright[3]
