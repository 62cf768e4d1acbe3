"""Tiles against a picture made pixel by pixel: bilinear slices, triangles with 4 x 4 samples, front to back."""

from __future__ import annotations

import numpy as np
import pytest

from ibrpipe.core.hierarchy import composite, order, triangles

WIDTH, HEIGHT = 45, 40
K = np.array([[60.0, 0.0, 22.0], [0.0, 62.0, 19.0], [0.0, 0.0, 1.0]])


def random_slices(count, seed):
    """Numbers, pixels, depths, and the texels of random slices."""
    rng = np.random.default_rng(seed)
    texels, numbers, pixels = [np.zeros(3, np.uint32)], np.empty((count, 14)), np.zeros((count, 8), np.int64)
    at = 3
    for n in range(count):
        width, height = rng.integers(3, 9, 2)
        code = rng.integers(0, 256, (height, width, 4))
        code[..., :3] = code[..., :3] * code[..., 3:] // 255
        grid = np.zeros((height + 2, width + 2), np.uint32)
        grid[1:-1, 1:-1] = (code * (1, 1 << 8, 1 << 16, 1 << 24)).sum(axis=-1)
        texels.append(grid.ravel())
        turn, zoom = rng.uniform(0, 6.28), rng.uniform(0.3, 0.9)
        c, s = zoom * np.cos(turn), zoom * np.sin(turn)
        x, y = rng.uniform(5, WIDTH - 5), rng.uniform(5, HEIGHT - 5)
        numbers[n] = (
            c, s, width / 2 + 0.5 - c * x - s * y, -s, c, height / 2 + 0.5 + s * x - c * y, 0, 0, 1,
            *rng.uniform(0.2, 1.5, 3), rng.uniform(0.6, 1.0), rng.uniform(0.6, 2.0),
        )  # fmt: skip
        reach = 0.75 * (width + height + 2) / zoom
        pixels[n, :4] = max(x - reach, 0), min(x + reach, WIDTH), max(y - reach, 0), min(y + reach, HEIGHT)
        pixels[n, 4:7] = at, width, height
        at += grid.size
    return (
        numbers,
        pixels,
        rng.uniform(2, 9, count).astype(np.float32),
        np.concatenate([*texels, np.zeros(3, np.uint32)]),
    )


def random_triangles(count, seed):
    """Numbers, boxes, and (corners, colours) of random triangles in the camera's frame, ambient light only."""
    rng = np.random.default_rng(seed)
    corners = rng.uniform(-1, 1, (count, 1, 3)) * (1.6, 1.4, 3) + (0, 0, 6) + rng.uniform(-1, 1, (count, 3, 3))
    paints = rng.uniform(0, 1, (count, 3, 3))
    numbers, boxes = np.empty((count, 21), np.float32), np.empty((count, 4), np.int64)
    pose = np.eye(4)[:3].reshape(1, 12)
    triangles.emit_triangles(
        np.array([[0, 0, count, 0, 1]]), pose, corners.astype(np.float32), paints.astype(np.float32),
        np.zeros((1, 2)), (K, np.array([WIDTH, HEIGHT, 0.01])), np.zeros((0, 3)), np.ones((1, 3)), numbers, boxes,
    )  # fmt: skip
    return numbers, boxes, corners, paints


def tiles_of(boxes, sequence):
    starts = np.zeros(5, np.int64)
    items = np.empty(order.count_tiles(sequence, boxes, 2, starts), np.int64)
    order.fill_tiles(sequence, boxes, 2, starts, items)
    return starts, items


NOTHING = (np.empty((0, 0, 3), np.float32), np.empty((0, 0), np.float32), np.empty((0, 0), np.float32))


def draw(slices, faces, groups=2, noted=True, captured=NOTHING):
    numbers, pixels, depths, texels = slices
    sequence = np.argsort(depths, kind="stable")
    pairs = np.lib.stride_tricks.as_strided(
        np.append(texels, np.zeros(len(texels) % 2, np.uint32)).view(np.uint64), (len(texels) - 1,), (4,)
    )
    color, alpha = np.empty((HEIGHT, WIDTH, 3), np.float32), np.empty((HEIGHT, WIDTH), np.float32)
    depth = np.empty((HEIGHT, WIDTH), np.float32)
    composite.draw_tiles(
        np.array([3, 0, 2, 1]), groups, np.array([2, WIDTH, HEIGHT]),
        (*tiles_of(pixels, sequence), numbers, pixels, depths), pairs,
        (*tiles_of(faces[1], np.arange(len(faces[1]))), faces[0], faces[1]), captured, noted, color, alpha, depth,
    )  # fmt: skip
    return color, alpha, depth


def slice_texel(number, pixel, texels, x, y):
    """Premultiplied colour and coverage of one slice at a pixel."""
    w = number[6:9] @ (x, y, 1)
    u, v = number[0:3] @ (x, y, 1) / w, number[3:6] @ (x, y, 1) / w
    first, width, height = pixel[4:7]
    if not (0 < u < width + 1 and 0 < v < height + 1):
        return np.zeros(4)
    grid = texels[first : first + (width + 2) * (height + 2)].reshape(height + 2, width + 2)
    i, j = int(u), int(v)
    total = np.zeros(4)
    for di, dj in ((0, 0), (1, 0), (0, 1), (1, 1)):
        weight = (u - i if di else 1 - u + i) * (v - j if dj else 1 - v + j)
        code = int(grid[j + dj, i + di])
        total += weight * np.array([code & 255, code >> 8 & 255, code >> 16 & 255, code >> 24])
    total /= 255
    return total * number[9:13] * (number[13] - (number[13] - 1) * total[3])


def pixel_fragments(corners, paints, x, y):
    """Fragments (depth, colour, share of what is left) of the triangles in a pixel, nearest first."""
    samples, hits = [(x + (i + 0.5) / 4, y + (j + 0.5) / 4) for j in range(4) for i in range(4)], []
    for place in samples:
        ray = np.linalg.solve(K, (*place, 1))
        best = None
        for f, (p, q, r) in enumerate(corners):
            matrix = np.stack([q - p, r - p, -ray], axis=1)
            s, t, z = np.linalg.solve(matrix, -p)
            if s >= 0 and t >= 0 and s + t <= 1 and z > 0.01 and (best is None or z < best[0]):
                best = (z, f, (1 - s - t) * paints[f][0] + s * paints[f][1] + t * paints[f][2])
        if best:
            hits.append(best)
    faces = sorted({h[1] for h in hits}, key=lambda f: min(h[0] for h in hits if h[1] == f))
    left, found = 16, []
    for f in faces:
        mine = [h for h in hits if h[1] == f]
        found.append((np.mean([h[0] for h in mine]), np.mean([h[2] for h in mine], axis=0), len(mine) / left))
        left -= len(mine)
    return found


def twin(slices, faces, captured=None):
    """Premultiplied colour and coverage of every pixel."""
    numbers, pixels, depths, texels = slices
    out = np.zeros((HEIGHT, WIDTH, 4))
    for y in range(HEIGHT):
        for x in range(WIDTH):
            layers = [
                (depths[n], *_split(slice_texel(numbers[n], pixels[n], texels, x + 0.5, y + 0.5)))
                for n in range(len(depths))
            ]
            layers += [(z, share * color, share) for z, color, share in pixel_fragments(*faces[2:], x, y)]
            if captured is not None and np.isfinite(captured[2][y, x]):
                share = captured[1][y, x]
                layers.append((captured[2][y, x], share * captured[0][y, x], share))
            clear = 1.0
            for _, color, share in sorted(layers, key=lambda layer: layer[0]):
                out[y, x, :3] += clear * color
                clear *= 1 - share
            out[y, x, 3] = 1 - clear
    return out


def _split(texel):
    return texel[:3], texel[3]


NO_TRIANGLES = (np.empty((0, 21), np.float32), np.empty((0, 4), np.int64), np.empty((0, 3, 3)), np.empty((0, 3, 3)))


def test_slices_are_blended_from_front_to_back():
    slices = random_slices(9, 0)
    color, alpha, depth = draw(slices, NO_TRIANGLES)
    wanted = twin(slices, NO_TRIANGLES)
    # weights are sixteenths of a texel: single texels differ by up to 1/16 of their contrast
    np.testing.assert_allclose(alpha, wanted[..., 3], atol=0.07)
    assert np.abs(alpha - wanted[..., 3]).mean() < 0.006
    assert np.abs(color * alpha[..., None] - wanted[..., :3]).mean() < 0.006
    assert ((alpha > 0) == np.isfinite(depth)).all()
    shown = alpha > 0.5
    assert (depth[shown] >= slices[2].min()).all()
    assert (depth[shown] <= slices[2].max()).all()


def test_triangles_are_sampled_and_split_by_depth():
    faces = random_triangles(12, 1)
    empty = tuple(each[:0] for each in random_slices(1, 0)[:3])
    color, alpha, _ = draw((*empty, np.zeros(4, np.uint32)), faces)
    wanted = twin((*empty, np.zeros(4, np.uint32)), faces)
    assert 0.1 < wanted[..., 3].mean() < 0.95
    assert np.abs(alpha - wanted[..., 3]).max() < 0.13
    assert np.abs(alpha - wanted[..., 3]).mean() < 0.002
    assert np.abs(color * alpha[..., None] - wanted[..., :3]).mean() < 0.004


def test_slices_and_triangles_are_put_in_one_order():
    slices, faces = random_slices(8, 2), random_triangles(6, 3)
    color, alpha, _ = draw(slices, faces)
    wanted = twin(slices, faces)
    assert np.abs(alpha - wanted[..., 3]).mean() < 0.01
    assert np.abs(color * alpha[..., None] - wanted[..., :3]).mean() < 0.01


def test_what_other_renderers_drew_is_put_between_by_depth_and_coverage():
    slices, faces = random_slices(8, 2), random_triangles(6, 3)
    rng = np.random.default_rng(7)
    depth = rng.uniform(2, 9, (HEIGHT, WIDTH)).astype(np.float32)
    depth[rng.random(depth.shape) < 0.2] = np.inf
    alpha = rng.choice(np.float32([0.0, 0.3, 0.7, 1.0]), depth.shape)
    color = rng.random((HEIGHT, WIDTH, 3)).astype(np.float32)
    alpha[~np.isfinite(depth)] = 0.0
    found, cover, _ = draw(slices, faces, captured=(color, alpha, depth))
    wanted = twin(slices, faces, (color, alpha, depth))
    assert np.abs(cover - wanted[..., 3]).mean() < 0.01
    assert np.abs(found * cover[..., None] - wanted[..., :3]).mean() < 0.01
    alone = draw(tuple(each[:0] for each in slices[:3]) + slices[3:], NO_TRIANGLES, captured=(color, alpha, depth))
    np.testing.assert_allclose(alone[1], alpha, atol=1e-6)
    np.testing.assert_allclose(alone[0], np.where(alpha[..., None] > 0, color, 0.0), atol=1e-5)
    np.testing.assert_allclose(alone[2], np.where(alpha > 0, depth, np.inf), rtol=1e-5)


@pytest.mark.parametrize(
    ("order", "wanted"),
    [((1.0, 4.0), (0.5, 0.125, 0)), ((6.0, 4.0), (0.375, 0.25, 0))],
    ids=["captured before", "captured behind"],
)
def test_captured_fragments_stand_among_partial_triangles_by_depth(order, wanted):
    near, middle = order
    pixel = np.array([(20.0, 20.0), (20.5, 20.0), (20.5, 20.5), (20.0, 20.5)])  # a quarter of pixel (20, 20)
    corners = np.array([((x - K[0, 2]) / K[0, 0], (y - K[1, 2]) / K[1, 1], 1) for x, y in pixel]) * middle
    numbers, boxes = np.empty((2, 21), np.float32), np.empty((2, 4), np.int64)
    triangles.emit_triangles(
        np.array([[0, 0, 2, 0, 1]]), np.eye(4)[:3].reshape(1, 12), corners[[[0, 1, 2], [0, 2, 3]]].astype(np.float32),
        np.tile(np.float32([0, 1, 0]), (2, 3, 1)), np.zeros((1, 2)), (K, np.array([WIDTH, HEIGHT, 0.01])),
        np.zeros((0, 3)), np.ones((1, 3)), numbers, boxes,
    )  # fmt: skip
    color = np.tile(np.float32([1, 0, 0]), (HEIGHT, WIDTH, 1))
    captured = (color, np.full((HEIGHT, WIDTH), 0.5, np.float32), np.full((HEIGHT, WIDTH), near, np.float32))
    nothing = (*(each[:0] for each in random_slices(1, 0)[:3]), np.zeros(4, np.uint32))
    found, cover, _ = draw(nothing, (numbers, boxes), captured=captured)
    np.testing.assert_allclose(found[20, 20] * cover[20, 20], wanted, atol=1e-5)


@pytest.mark.parametrize("groups", [1, 3])
def test_how_tiles_are_dealt_changes_nothing(groups):
    slices, faces = random_slices(8, 4), random_triangles(6, 5)
    for one, other in zip(draw(slices, faces, groups), draw(slices, faces)):
        np.testing.assert_array_equal(one, other)


def test_a_triangle_over_whole_tiles_is_drawn_without_samples():
    corners = np.array([[[-40, -40, 5.0], [80, -40, 7.0], [-40, 80, 9.0]]])
    numbers, boxes = np.empty((1, 21), np.float32), np.empty((1, 4), np.int64)
    paints = np.array([[[1, 0, 0], [0, 1, 0], [0, 0, 1.0]]], np.float32)
    triangles.emit_triangles(
        np.array([[0, 0, 1, 0, 1]]), np.eye(4)[:3].reshape(1, 12), corners.astype(np.float32), paints, np.zeros((1, 2)),
        (K, np.array([WIDTH, HEIGHT, 0.01])), np.zeros((0, 3)), np.ones((1, 3)), numbers, boxes,
    )  # fmt: skip
    slices = random_slices(1, 0)
    color, alpha, depth = draw((*(each[:0] for each in slices[:3]), slices[3]), (numbers, boxes))
    assert (alpha == 1).all()
    for x, y in ((0, 0), (20, 33), (44, 39)):
        ray = np.linalg.solve(K, (x + 0.5, y + 0.5, 1))
        p, q, r = corners[0]
        s, t, z = np.linalg.solve(np.stack([q - p, r - p, -ray], axis=1), -p)
        np.testing.assert_allclose(depth[y, x], z, rtol=1e-4)
        np.testing.assert_allclose(color[y, x], (1 - s - t, s, t), atol=1e-4)


def test_without_anything_the_picture_is_empty():
    slices = random_slices(1, 0)
    color, alpha, depth = draw((*(each[:0] for each in slices[:3]), slices[3]), NO_TRIANGLES)
    assert not color.any()
    assert not alpha.any()
    assert np.isinf(depth).all()
