"""The steps of the fast residual pass, and both passes whole, against plain twins."""

from __future__ import annotations

import math

import numpy as np
import pytest
import spiral_twin as twin
from kernel_runs import on_all_thread_counts
from spiral_scene import CAMERA, frames_of, members, picture, tables_of

from ibrpipe.core.spiral import shade as steps
from ibrpipe.core.spiral.lookup import shade
from ibrpipe.renderers.pixel_grid import PixelGrid

BOTH = pytest.mark.parametrize("closed", [True, False])
BATCH = steps.BATCH


def limit_of(member):
    return math.radians(87) if member.closed else math.pi / 2


def rays(count, seed=0, beyond=30):
    """Pixel places (count, 2) up to `beyond` pixels off the picture, camera depths, and directions of rays."""
    rng = np.random.default_rng(seed)
    xy, z = rng.uniform((-beyond, -beyond), (11 + beyond, 9 + beyond), (count, 2)), rng.uniform(3.0, 4.6, count)
    directions = np.column_stack([xy, np.ones(count)]) @ CAMERA.world_from_pixel.T
    return xy, z, directions


def state_of(xy, z, directions):
    state = np.full((6, len(z)), np.nan)
    state[steps.X], state[steps.Y], state[steps.Z] = xy[:, 0], xy[:, 1], z
    state[steps.LENGTH] = np.linalg.norm(directions, axis=1)
    return state


def places(xy, z, directions, member):
    """What the twin says of every ray: (preference, place in the rectangle, direction to the eye, 1 / edges)."""
    points = CAMERA.center + z[:, None] * directions
    views = -directions / np.linalg.norm(directions, axis=1, keepdims=True)
    return [twin._place(point, view, member) for point, view in zip(points, views)]


def batches():
    return np.full((8, BATCH), np.nan), np.full((12, BATCH), np.nan, np.float32), *np.zeros((2, 4, BATCH), np.uint32)


def test_the_best_texture_is_the_one_that_the_ray_suits_most():
    found, ray = members(), rays(150)
    frames, state = frames_of(tables_of(found)), state_of(*ray)
    score = np.array([[each[0] for each in places(*ray, member)] for member in found])
    for asked in (0b00, 0b01, 0b10, 0b11):
        used = np.full(150, asked)
        steps.choose_textures(150, frames, used, state)
        left = np.where([[asked >> t & 1] for t in range(2)], -1.0, score)
        best = np.where(left.max(axis=0) > -1, left.argmax(axis=0), -1)
        np.testing.assert_array_equal(state[steps.BEST], best)
        np.testing.assert_allclose(state[steps.WORTH], left.max(axis=0), atol=1e-9)
    assert set(score.argmax(axis=0)) == {0, 1}
    steps.choose_textures(0, frames, used, state)  # no pixels: nothing happens


def looked(ray, which, closed):
    """`work` after look_along for the rays that look at texture `which` from the front, and what the twin says."""
    found = members(closed)
    tables, front = tables_of(found), np.array([each[2][2] > 0.05 for each in places(*ray, found[which])])
    ray = tuple(part[front] for part in ray)
    work, count = batches()[0], len(ray[1])
    work[steps.HERE, :count], work[steps.ABOVE, :count] = ray[0].T
    work[steps.SHARE, :count] = ray[1]
    steps.look_along(count, which, frames_of(tables), tables.arrays[0], work)
    return work, found, tables, places(*ray, found[which])


@BOTH
@pytest.mark.parametrize("which", [0, 1])
def test_places_and_turns_of_a_batch_equal_the_twin(which, closed):
    work, found, _, wanted = looked(rays(200, 1), which, closed)
    member, count = found[which], len(wanted)
    np.testing.assert_allclose(work[[steps.U, steps.V, steps.BELOW], :count].T, [each[1] for each in wanted], atol=1e-9)
    ways = np.array([each[2] for each in wanted])
    np.testing.assert_allclose(work[steps.PITCH, :count], np.arccos(ways[:, 2]), atol=1e-7)
    below, above, share, _ = twin.turns_around(ways, member.k, limit_of(member), twin._closing(member))
    for row, values in ((steps.HERE, below), (steps.ABOVE, above), (steps.SHARE, share)):
        np.testing.assert_allclose(work[row, :count], values, atol=1e-7)
    assert np.isnan(work[:, count:]).all()
    assert 60 < count < BATCH


@BOTH
@pytest.mark.parametrize("which", [0, 1])
def test_images_of_a_batch_and_their_weights_equal_the_twin(which, closed):
    work, found, tables, wanted = looked(rays(200, 2), which, closed)
    member, count, first = found[which], len(wanted), which * len(found[0].alphas)
    _, part, images, _ = batches()
    steps.find_images(count, which, tables.arrays[0], tables.arrays[1], work, part, images)
    dense = np.zeros((count, len(member.alphas)))
    for m in range(4):
        np.add.at(dense, (np.arange(count), images[m, :count].astype(int) - first), part[steps.IMAGE + m, :count])
    ways = np.array([each[2] for each in wanted])
    known = twin.lookup(ways, member.alphas, member.k, limit_of(member), twin._closing(member))
    np.testing.assert_allclose(dense, known, atol=1e-6)


def test_four_images_are_read_as_the_twin_reads_them():
    rng, found = np.random.default_rng(3), members()
    tables, which, count = tables_of(found), 1, 150
    first, sizes = len(found[0].alphas), found[1].sizes
    work, part, images, texels = batches()
    local = rng.uniform(-0.3, 1.3, (count, 3)) * (1, 1, 0.3)
    work[[steps.U, steps.V, steps.BELOW], :count] = local.T
    images[:, :count] = first + rng.integers(0, len(sizes), (4, count))
    weights = rng.dirichlet(np.ones(4), count).astype(np.float32)
    weights[np.arange(count), rng.integers(0, 4, count)] = 0
    part[steps.IMAGE : steps.IMAGE + 4, :count] = weights.T
    steps.add_images(count, which, tables.arrays[2], work, part, images, texels)
    member, scale = twin._images(found[1]), tables.scales[which]
    wanted = [
        twin.residual_at(local[n], weights[n], [member[i - first] for i in images[:, n].astype(int)], scale)
        for n in range(count)
    ]
    np.testing.assert_allclose(part[steps.SUM : steps.SUM + 4, :count].T, wanted, atol=2e-4)
    assert 50 < (np.array(wanted)[:, 3] > 0).sum() < count


def hit_memory(size):
    whole = (np.zeros(size, np.int64) for _ in range(3))
    return np.full((6, size), np.nan), np.full((4, size), 7, np.float32), *whole


@pytest.mark.parametrize("row", [0, 4, 8])
def test_hits_with_a_colour_are_listed_row_by_row(row):
    _, depth = picture()
    known = (np.random.default_rng(4).random(depth.shape) < 0.8).astype(np.float32)
    state, total, pixels, used, active = hit_memory(steps.ROWS * 11)
    used[:] = 3
    way = CAMERA.world_from_pixel
    count = steps.list_hits(
        depth, known, row, PixelGrid.centers(*depth.shape).arrays, way, state, pixels, used, active, total
    )
    wanted = [(y, x) for y, x in np.argwhere(np.isfinite(depth) & (known > 0)) if row <= y < row + steps.ROWS]
    assert count == len(wanted)
    assert list(pixels[:count]) == [11 * y + x for y, x in wanted]
    assert list(active[:count]) == list(range(count))
    assert not used[:count].any()
    assert not total[:, :count].any()
    for n, (y, x) in enumerate(wanted):
        assert tuple(state[:3, n]) == (x + 0.5, y + 0.5, depth[y, x])
        assert state[steps.LENGTH, n] == pytest.approx(np.linalg.norm(way @ (x + 0.5, y + 0.5, 1)))
    nothing = np.full(depth.shape, np.inf, np.float32)
    assert (
        steps.list_hits(
            nothing, known, row, PixelGrid.centers(*depth.shape).arrays, way, state, pixels, used, active, total
        )
        == 0
    )


def test_residuals_are_added_in_display_code_and_lost_pixels_counted():
    rng, tables = np.random.default_rng(5), tables_of(members())
    color = rng.uniform(0, 1.6, (4, 11, 3)).astype(np.float32)
    color[0, :3] = ((0, 0, 0), (1, 1, 1), (1e-4, 2e-3, 9.0))
    pixels, total = rng.permutation(44)[:30], rng.normal(0, 20, (4, 30)).astype(np.float32)
    total[3] = np.where(np.arange(30) < 5, 0, rng.uniform(0.1, 1, 30))
    out = color.copy()
    assert steps.add_to_colors(30, pixels, total, tables.encode, tables.decode, out) == 5
    wanted = color.reshape(-1, 3).astype(float)
    for n, pixel in enumerate(pixels):
        if n >= 5:
            code = twin._encode(wanted[pixel]) + total[:3, n] / total[3, n] / 255
            wanted[pixel] = twin._decode(np.maximum(code, 0))
    np.testing.assert_allclose(out.reshape(-1, 3), wanted, atol=3e-5, rtol=1e-5)
    assert (wanted == 0).any()
    assert (wanted > 1).any()


def residual_of(ray, n, member):
    """(R, G, B, weight) that one texture says to one ray."""
    _, local, view, scale = places(*(part[n : n + 1] for part in ray), member)[0]
    weights = twin.lookup(view[None], member.alphas, member.k, limit_of(member), twin._closing(member))[0]
    return twin.residual_at(local, weights, twin._images(member), scale)


def inner_rays(count, seed):
    """Rays of the picture that both textures see from the front."""
    xy, z, directions = rays(count, seed, 0)
    keep = np.array([[each[2][2] > 0.05 for each in places(xy, z, directions, m)] for m in members()]).all(axis=0)
    return xy[keep], z[keep], directions[keep]


def test_one_texture_adds_to_the_pixels_of_its_batch_alone():
    found, ray = members(), inner_rays(60, 6)
    tables, size = tables_of(found), len(ray[1])
    state, total, _, used, active = hit_memory(size)
    state[:] = state_of(*ray)
    total[:], active[:] = 0, np.arange(size)[::-1]  # which hit an entry is of
    batch = np.zeros((2, BATCH), np.int64)
    chosen = np.arange(0, size, 2)
    batch[1, : len(chosen)] = chosen
    spirals, finds, images = tables.arrays
    hit = state, used, active, total
    steps.ask_texture(len(chosen), 1, batch, frames_of(tables), spirals, finds, images, hit, batches())
    wanted = np.zeros((size, 4))
    for n in chosen:
        wanted[active[n]] = residual_of(ray, n, found[1])
    np.testing.assert_allclose(total.T, wanted, atol=5e-4)
    np.testing.assert_array_equal(used, np.where(np.arange(size) % 2 == 0, 0b10, 0))
    assert (wanted[:, 3] > 0).sum() > 5


def test_pixels_ask_the_next_texture_while_weight_is_missing():
    found, ray = members(), inner_rays(300, 7)
    tables, size = tables_of(found), len(ray[1])
    state, total, _, used, active = hit_memory(size)
    state[:] = state_of(*ray)
    total[:], active[:] = 0, np.arange(size)
    batch, counts = np.zeros((2, BATCH), np.int64), np.zeros(2, np.int64)
    spirals, finds, images = tables.arrays
    hit = state, used, active, total
    steps.ask_textures(size, frames_of(tables), spirals, finds, images, hit, batches(), batch, counts)
    wanted, asked = np.zeros((size, 4)), np.zeros(size, int)
    score = np.array([[each[0] for each in places(*ray, member)] for member in found])
    for n in range(size):
        for t in np.argsort(-score[:, n]):
            if wanted[n, 3] > 0.98:
                break
            wanted[n] += residual_of(ray, n, found[t])
            asked[n] += 1
    np.testing.assert_allclose(total.T, wanted, atol=1e-3)
    assert not counts.any()
    assert {1, 2} == set(asked)


@BOTH
def test_the_fast_pass_equals_the_twin_whatever_the_threads(closed):
    found = members(closed)
    tables, (color, depth) = tables_of(found), picture()
    known = np.ones_like(depth)
    known[2] = 0

    def added():
        out, lost = color.copy(), np.full(3, 99)
        steps.add_residuals(
            out, depth, known, PixelGrid.centers(*depth.shape).arrays, np.ascontiguousarray(CAMERA.world_from_pixel),
            frames_of(tables), *tables.arrays, tables.encode, tables.decode, lost
        )  # fmt: skip
        return out, lost

    out, lost = on_all_thread_counts(added)
    wanted, missing = twin.shaded(color, np.where(known > 0, depth, np.inf), CAMERA, found, True)
    np.testing.assert_allclose(out, wanted, atol=2e-5)
    assert lost.sum() == missing
    assert np.abs(out - color).max() > 0.05


@BOTH
@pytest.mark.parametrize("coded", [False, True])
def test_the_plain_pass_equals_the_twin_whatever_the_threads(closed, coded):
    found = members(closed, np.float32)
    tables, (color, depth) = tables_of(found), picture()

    def added():
        out, lost = color.copy(), np.full(len(depth), 99)
        frames, way = (tables.rotations, tables.origins, tables.scales), np.ascontiguousarray(CAMERA.world_from_pixel)
        shade(
            out,
            depth,
            PixelGrid.centers(*depth.shape).arrays,
            CAMERA.center,
            way,
            frames,
            *tables.arrays,
            coded,
            tables.encode,
            lost,
        )
        return out, lost

    out, lost = on_all_thread_counts(added)
    wanted, missing = twin.shaded(color, depth, CAMERA, found, coded)
    np.testing.assert_allclose(out, wanted, atol=2e-5)
    assert lost.sum() == missing


def test_nothing_hit_changes_nothing():
    tables, color = tables_of(members()), picture()[0]
    out, lost, nothing = color.copy(), np.full(2, 9), np.full((9, 11), np.inf, np.float32)
    way = np.ascontiguousarray(CAMERA.world_from_pixel)
    places = PixelGrid.centers(9, 11).arrays
    steps.add_residuals(out, nothing, np.ones_like(nothing), places, way, frames_of(tables), *tables.arrays,
                        tables.encode, tables.decode, lost)  # fmt: skip
    np.testing.assert_array_equal(out, color)
    assert not lost.any()
