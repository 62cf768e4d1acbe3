"""Interleaved timing against a clock that the test turns."""

from __future__ import annotations

import pytest

from ibrpipe.evaluation import timing
from ibrpipe.types import Camera


class Clock:
    def __init__(self):
        self.now, self.calls = 0.0, []

    def method(self, name, seconds):
        durations = iter(seconds)

        def prepare(camera):
            def draw():
                self.calls.append((name, camera.width))
                self.now += next(durations)

            return draw

        return prepare


@pytest.fixture
def clock(monkeypatch):
    made = Clock()
    monkeypatch.setattr(timing, "perf_counter", lambda: made.now)
    return made


def camera(width=64):
    return Camera.look_at((0, 0, 4), (0, 0, 0), width=width, height=48)


def test_methods_take_turns_and_the_second_draw_counts(clock):
    methods = {"a": clock.method("a", [9, 0.010, 9, 0.030, 9, 0.020]), "b": clock.method("b", [1, 0.5, 1, 0.7, 1, 0.9])}
    found = timing.time_methods(methods, [camera()], repeats=3)
    assert [name for name, _ in clock.calls] == ["a", "a", "b", "b"] * 3
    assert found["a"] == [pytest.approx(20.0)]
    assert found["b"] == [pytest.approx(700.0)]


def test_another_clock_may_tell_the_time():
    ticks = iter(range(100))
    found = timing.interleave({"a": lambda: None}, repeats=3, clock=lambda: float(next(ticks)))
    assert (found["a"].median, found["a"].count) == (1000.0, 3)


def test_slow_methods_leave_turns_out_but_take_one(clock):
    methods = {"slow": clock.method("slow", [5.0] * 20), "fast": clock.method("fast", [0.01] * 40)}
    timing.time_methods(methods, [camera()], repeats=7, seconds=1.0)
    names = [name for name, _ in clock.calls]
    assert (names.count("slow"), names.count("fast")) == (2, 14)


def test_every_camera_is_timed(clock):
    found = timing.time_methods({"a": clock.method("a", [0, 0.1, 0, 0.2])}, [camera(64), camera(32)], repeats=1)
    assert found["a"] == [pytest.approx(100.0), pytest.approx(200.0)]
    assert [width for _, width in clock.calls] == [64, 64, 32, 32]


def test_the_timed_size_keeps_the_shape():
    resized = timing.timed_size(Camera.look_at((0, 0, 4), (0, 0, 0), width=400, height=300), 640)
    assert (resized.width, resized.height) == (640, 480)
