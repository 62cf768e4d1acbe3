"""Renderer `prewarp` against the exact search of `ldi`: pictures of smooth fields, every side, singular eyes."""

from __future__ import annotations

import os
import subprocess
import sys

import numpy as np
import pytest
from kernel_runs import on_all_thread_counts

import ibrpipe
from ibrpipe.errors import RendererError
from ibrpipe.renderers.prewarp.renderer import projected_level

N = 96


def smooth(n=N, frame=None):
    y, x = np.mgrid[:n, :n] / n
    height = 0.08 + 0.06 * np.sin(7 * x + 1) * np.cos(6 * y)
    color = 0.5 + 0.4 * np.stack([np.sin(20 * x), np.cos(17 * y), np.sin(12 * (x + y))], axis=2)
    p = 1.0 / n
    frame = frame or ibrpipe.ParallelFrame((0, 0, 0), (p, 0, 0), (0, p, 0), (0, 0, 1))
    return ibrpipe.ReliefTexture(frame, color, height)


def compare(source, camera, **options):
    """Share of pixels that hit or miss otherwise, depth error over the others' size, colour rmse."""
    got = ibrpipe.render(source, camera, "prewarp", **options)
    want = ibrpipe.render(source, camera, "ldi")
    assert not np.isnan(got.depth).any()
    assert not np.isnan(got.color).any()
    both = np.isfinite(got.depth) & np.isfinite(want.depth)
    flips = (np.isfinite(got.depth) != np.isfinite(want.depth)).mean()
    error = np.abs(got.depth[both] - want.depth[both])
    rmse = np.sqrt(np.mean((got.color - want.color)[both] ** 2)) if both.any() else 0.0
    return flips, error, rmse, both.mean()


VIEWS = {
    "frontal": ((0.5, 0.45, 1.4), 45),
    "oblique": ((0.3, -0.6, 0.9), 50),
    "low": ((1.6, -0.3, 0.3), 50),
    "below": ((0.4, 0.6, -1.2), 45),
    "in the slab": ((1.7, 0.4, 0.1), 50),
    "corner": ((-0.5, -0.6, 0.5), 50),
}


@pytest.mark.parametrize("name", VIEWS)
@pytest.mark.parametrize("method", ["two-pass", "pipelined"])
@pytest.mark.parametrize("bits", [8, 32])
def test_smooth_field_from_every_side(name, method, bits):
    eye, fov = VIEWS[name]
    camera = ibrpipe.Camera.look_at(eye, (0.5, 0.5, 0.08), (0.1, 1, 0.2), fov, 160, 120)
    flips, error, rmse, covered = compare(smooth(), camera, method=method, depth_bits=bits, level=0)
    folded = name in ("low", "in the slab", "corner")  # silhouettes: another surface within a texel of the edge
    assert covered > 0.05
    assert flips < 0.007
    assert np.quantile(error, 0.9 if folded else 0.99) < (1.5 if folded else 0.5) / N
    assert folded or rmse < 1 / 255


@pytest.mark.parametrize("method", ["two-pass", "pipelined"])
def test_area_filter_averages_what_is_reduced(method):
    rng = np.random.default_rng(3)
    source = ibrpipe.ReliefTexture(smooth().frame, rng.random((N, N, 3)), smooth().height)
    camera = ibrpipe.Camera.look_at((0.3, -0.6, 0.9), (0.5, 0.5, 0.08), (0.1, 1, 0.2), 48, 80, 60)
    fine = ibrpipe.render(source, camera.resized(480, 360), "ldi")
    truth = fine.color.reshape(60, 6, 80, 6, 3).mean(axis=(1, 3))
    covered = fine.alpha.reshape(60, 6, 80, 6).mean(axis=(1, 3)) == 1
    errors = {}
    for name in ("point", "area"):
        frame = ibrpipe.render(source, camera, "prewarp", method=method, filter=name, level=0)
        assert (covered & (frame.alpha == 0)).mean() < 0.01
        both = covered & (frame.alpha > 0)
        errors[name] = np.sqrt(np.mean((frame.color - truth)[both] ** 2))
    assert errors["area"] < 0.85 * errors["point"], errors  # the view after it still samples white noise
    flips, error, _, _ = compare(smooth(), camera, method=method, filter="area", level=0)
    assert flips < 0.01
    assert np.quantile(error, 0.95) < 0.5 / N


def blocks(n=128):
    """Posts of several heights on a plain."""
    rng = np.random.default_rng(2)
    height = np.zeros((n, n))
    for _ in range(30):
        r, c = rng.integers(4, n - 14, 2)
        height[r : r + rng.integers(3, 10), c : c + rng.integers(3, 10)] = rng.uniform(0.03, 0.15)
    p = 1.0 / n
    frame = ibrpipe.ParallelFrame((0, 0, 0), (p, 0, 0), (0, p, 0), (0, 0, 1))
    return ibrpipe.ReliefTexture(frame, rng.random((n, n, 3)), height)


def test_fold_overs_are_right_in_the_pipelined_method():
    source = blocks()
    camera = ibrpipe.Camera.look_at((-0.2, -0.3, 0.5), (0.5, 0.5, 0.05), (0, 0, 1), 45, 320, 240)
    wrong = {m: (compare(source, camera, method=m)[1] > 2 / 128).mean() for m in ("two-pass", "pipelined")}
    assert wrong["pipelined"] < 0.02
    assert wrong["two-pass"] > 1.5 * wrong["pipelined"], wrong


def test_far_from_the_origin_and_tiny():
    for shift, scale in ((1e6, 1.0), (0.0, 1e-6)):
        p = scale / N
        frame = ibrpipe.ParallelFrame((shift, shift, 0), (p, 0, 0), (0, p, 0), (0, 0, 1))
        source = smooth(frame=frame)
        source = ibrpipe.ReliefTexture(frame, source.color, source.height * scale)
        middle = np.array([shift + 0.5 * scale, shift + 0.5 * scale, 0.08 * scale])
        camera = ibrpipe.Camera.look_at(middle + scale * np.array([0.3, -0.7, 0.9]), middle, (0, 1, 0), 45, 80, 60)
        flips, error, rmse, covered = compare(source, camera)
        assert covered > 0.2
        assert flips < 0.01
        assert np.quantile(error, 0.99) < 0.5 * p
        assert rmse < 1 / 255


def test_slanted_frame():
    frame = ibrpipe.ParallelFrame(
        (0, 0, 0), (0.01, 0.002, 0), (-0.003, 0.012, 0.001), np.array([0.1, 0.2, 0.9]) / np.sqrt(0.86)
    )
    source = smooth(frame=frame)
    camera = ibrpipe.Camera.look_at((0.3, -0.6, 1.5), (0.4, 0.6, 0.1), (0, 1, 0), 45, 120, 90)
    flips, error, rmse, covered = compare(source, camera)
    assert covered > 0.2
    assert flips < 0.01
    assert np.quantile(error, 0.99) < 0.005
    assert rmse < 1 / 255


@pytest.mark.parametrize(
    "eye", [(0.5, 0.5, 0.08), (0.5, 0.5, 0.0), (0.2, 0.7, 0.14), (0.5, 0.5, 0.1400001), (2, 0.5, 0.02)]
)
def test_singular_eyes_give_no_nan_and_nothing_behind(eye):
    source = smooth()
    for target in ((0.9, 0.5, 0.08), (0.5, 0.9, 0.3)):
        camera = ibrpipe.Camera.look_at(eye, target, (0, 0, 1), 70, 64, 48)
        for fallback in ("auto", "never"):
            frame = ibrpipe.render(source, camera, "prewarp", fallback=fallback)
            assert not np.isnan(frame.depth).any()
            assert (frame.depth > 0).all()
            assert not np.isnan(frame.color).any()
            assert ((frame.alpha > 0) == np.isfinite(frame.depth)).all()


def test_an_eye_in_the_relief_gets_the_exact_picture():
    source = smooth()
    camera = ibrpipe.Camera.look_at((0.5, 0.5, 0.08), (0.9, 0.5, 0.08), (0, 0, 1), 70, 64, 48)
    got, want = ibrpipe.render(source, camera, "prewarp"), ibrpipe.render(source, camera, "ldi")
    assert got.stats["exact"] == 1
    np.testing.assert_array_equal(got.depth, want.depth)
    np.testing.assert_array_equal(got.color, want.color)
    far = ibrpipe.Camera.look_at((0.5, 0.5, 3), (0.5, 0.5, 0), (0, 1, 0), 40, 64, 48)
    assert ibrpipe.render(source, far, "prewarp").stats["exact"] == 0
    assert ibrpipe.render(source, far, "prewarp", fallback="always").stats["exact"] == 1


def test_levels_of_the_pyramid():
    source = smooth()
    far = ibrpipe.Camera.look_at((0.5, 0.4, 3), (0.5, 0.5, 0), (0, 1, 0), 40, 64, 48)
    prepared = ibrpipe.prepare(source, "prewarp")
    before = prepared.data.bytes
    wanted = ibrpipe.render(source, far, "ldi")
    errors = []
    for level in (0, "auto", 2, 3):
        frame = ibrpipe.render(prepared, far, "prewarp", level=level)
        both = np.isfinite(frame.depth) & np.isfinite(wanted.depth)
        errors.append(np.sqrt(np.mean((frame.depth[both] - wanted.depth[both]) ** 2)))
    assert projected_level(prepared.data.reliefs[0], far) == 2
    assert errors[1] == errors[2]
    assert errors[0] < errors[1] < errors[3] < 0.02
    assert prepared.data.bytes > before == 0


def test_steps_above_the_threshold_are_parted():
    source = blocks()
    camera = ibrpipe.Camera.look_at((0.2, 0.3, 1.5), (0.5, 0.5, 0.05), (0, 1, 0), 45, 160, 120)
    whole = ibrpipe.render(source, camera, "prewarp", method="pipelined")
    parted = ibrpipe.render(source, camera, "prewarp", method="pipelined", max_step=1.0)
    assert np.isfinite(whole.depth).sum() > np.isfinite(parted.depth).sum() > 0.7 * np.isfinite(whole.depth).sum()


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"method": "one-pass"}, "method is 'one-pass'"),
        ({"depth_bits": 16}, "depth_bits is 16"),
        ({"level": -1}, "level is -1"),
        ({"max_step": 0.0}, "max_step is 0.0"),
        ({"fallback": "maybe"}, "fallback is 'maybe'"),
        ({"quads": "four"}, "quads is 'four'"),
        ({"filter": "blur"}, "filter is 'blur'"),
    ],
)
def test_options_out_of_range_are_named(options, text):
    camera = ibrpipe.Camera.look_at((0.5, 0.4, 3), (0.5, 0.5, 0), (0, 1, 0), 40, 8, 8)
    with pytest.raises(RendererError, match=text):
        ibrpipe.render(smooth(8), camera, "prewarp", **options)


@pytest.mark.parametrize("shape", [(1, 1), (1, 7), (9, 1), (2, 2), (5, 33)])
def test_small_and_odd_sizes_do_not_fail(shape):
    height = np.random.default_rng(1).random(shape)
    frame = ibrpipe.ParallelFrame((0, 0, 0), (0.1, 0, 0), (0, 0.1, 0), (0, 0, 1))
    source = ibrpipe.ReliefTexture(frame, np.ones((*shape, 3)), height)
    camera = ibrpipe.Camera.look_at((0.3, -2.0, 3.0), (0.3, 0.3, 0.5), (0, 0, 1), 40, 48, 36)
    assert not np.isnan(ibrpipe.render(source, camera, "prewarp").depth).any()


@pytest.mark.parametrize("method", ["two-pass", "pipelined"])
@pytest.mark.parametrize("name", ["point", "area"])
def test_texels_without_displacement_stay_where_they_are(method, name):
    """A flat texture is planar texture mapping: bilinear, texel and pixel centres at halves."""
    color = np.random.default_rng(8).random((24, 32, 3)).astype(np.float32)
    frame = ibrpipe.ParallelFrame((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1))
    source = ibrpipe.ReliefTexture(frame, color, np.zeros((24, 32)))
    camera = ibrpipe.Camera.look_at((13, -9, 30), (15, 11, 0), (0.1, 1, 0), 30, 60, 45)
    frame = ibrpipe.render(source, camera, "prewarp", method=method, filter=name, level=0)
    row, column = np.indices((45, 60)) + 0.5
    rays = np.stack([column, row, np.ones_like(row)], -1) @ camera.world_from_pixel.T
    t = -camera.center[2] / rays[..., 2]
    u, v = ((camera.center + t[..., None] * rays)[..., k] for k in (0, 1))
    inside = (u > 1) & (u < 31) & (v > 1) & (v < 23)
    i, j = np.floor(u - 0.5).clip(0, 30).astype(int), np.floor(v - 0.5).clip(0, 22).astype(int)
    p, q = (u - 0.5 - i)[..., None], (v - 0.5 - j)[..., None]
    above = (1 - p) * color[j, i] + p * color[j, i + 1]
    want = (1 - q) * above + q * ((1 - p) * color[j + 1, i] + p * color[j + 1, i + 1])
    assert inside.mean() > 0.5
    assert (frame.alpha[inside] == 1).all()
    np.testing.assert_allclose(frame.depth[inside], t[inside], rtol=1e-5)
    if name == "point":
        np.testing.assert_allclose(frame.color[inside], want[inside], atol=1e-4)
    else:
        assert np.abs(frame.color - want)[inside].mean() < 0.2


def test_transparent_texels_are_holes_and_all_of_them_nothing():
    source = smooth()
    height = source.height.copy()
    height[30:60, 40:70] = np.nan
    camera = ibrpipe.Camera.look_at((0.5, 0.4, 1.5), (0.5, 0.5, 0), (0, 1, 0), 45, 160, 120)
    flips, *_ = compare(ibrpipe.ReliefTexture(source.frame, source.color, height), camera)
    assert flips < 0.01
    empty = ibrpipe.ReliefTexture(source.frame, source.color, np.full_like(height, np.nan))
    assert np.isinf(ibrpipe.render(empty, camera, "prewarp").depth).all()


def test_two_textures_interpenetrate():
    one = smooth()
    frame = ibrpipe.ParallelFrame((0, 0.02, 0.05), one.frame.a, one.frame.b, one.frame.f)
    other = ibrpipe.ReliefTexture(frame, 1 - one.color, one.height.T.copy())
    camera = ibrpipe.Camera.look_at((0.3, -0.5, 1.0), (0.5, 0.5, 0.1), (0, 1, 0), 45, 160, 120)
    flips, error, _, covered = compare([one, other], camera)
    assert covered > 0.3
    assert flips < 0.01
    assert np.quantile(error, 0.99) < 0.5 / N


@pytest.mark.parametrize("options", [{}, {"filter": "area"}, {"method": "pipelined", "filter": "area"}], ids=str)
def test_threads_change_no_byte(options):
    camera = ibrpipe.Camera.look_at((0.3, -0.6, 0.9), (0.5, 0.5, 0.1), (0, 1, 0), 45, 96, 72)

    def shot():
        frame = ibrpipe.render(smooth(), camera, "prewarp", **options)
        return frame.depth, frame.color, frame.alpha

    on_all_thread_counts(shot)


def test_perspective_layers_are_refused():
    camera = ibrpipe.Camera.look_at((0, 0, 5), (0, 0, 0), (0, 1, 0), 45, 4, 3)
    offsets = np.zeros((3, 5), np.int64)
    layers = ibrpipe.LayeredDepthImage(camera, offsets, np.empty(0), np.empty((0, 3)), np.empty((0, 3)))
    with pytest.raises(RendererError, match="parallel frames"):
        ibrpipe.render(layers, camera, "prewarp")


SCRIPT = """
import numpy as np, sys
import ibrpipe
rng = np.random.default_rng(11)
frame = ibrpipe.ParallelFrame((0, 0, 0), (1, 0, 0), (0, 1, 0.1), (0, 0, 1))
height = rng.random((7, 9)) * 2
height[2, 3] = np.nan
relief = ibrpipe.ReliefTexture(frame, rng.random((7, 9, 3)), height)
camera = ibrpipe.Camera.look_at((2, -4, 6), (3, 3, 1), width=13, height=11)
chosen = [{}, {"method": "pipelined"}, {"filter": "area"}, {"method": "pipelined", "filter": "area"}]
seen = [ibrpipe.render(relief, camera, "prewarp", **options) for options in chosen]
np.savez(sys.argv[1], depth=[each.depth for each in seen], color=[each.color for each in seen])
"""


def run(path, **environment):
    subprocess.run([sys.executable, "-c", SCRIPT, str(path)], check=True, env={**os.environ, **environment})
    return np.load(path)


def test_compiled_equals_plain_python(tmp_path):
    compiled, plain = run(tmp_path / "a.npz"), run(tmp_path / "b.npz", NUMBA_DISABLE_JIT="1")
    assert np.isfinite(compiled["depth"]).sum() > 20
    np.testing.assert_allclose(compiled["depth"], plain["depth"], rtol=1e-4)
    np.testing.assert_allclose(compiled["color"], plain["color"], atol=1e-3)
