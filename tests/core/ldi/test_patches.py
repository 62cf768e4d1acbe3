"""Links, groups and corners of layered images against sets, patch by patch."""

from __future__ import annotations

import ldi_twin
import numpy as np
import pytest
from small_fields import FRAME, layers

from ibrpipe.core.ldi import patches, quadtree
from ibrpipe.renderers.fields import _steps
from ibrpipe.types import Camera, LayeredDepthImage

GAP = 4.0


def small(kind, shape):
    rows, columns = shape
    own = Camera.look_at((1, 2, 3), (0.5, -1, 0), width=columns, height=rows)
    return layers(shape, frame=own if kind == "perspective" else FRAME)


def linked(source):
    depth, step, margin = _steps(source)
    links = np.full((4, len(depth)), -1, np.int32)
    patches.link_samples(source.offsets, depth, step, margin, GAP, links)
    return depth, step, links


def grouped(source, links):
    rows, columns = source.shape
    counts, none = np.empty((rows + 1, columns + 1), np.int32), np.empty((0, 4), np.int32)
    patches.group_cells(source.offsets, links, np.empty(0, np.int64), counts, none)
    starts = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    samples = np.full((starts[-1], 4), -7, np.int32)
    patches.group_cells(source.offsets, links, starts, counts, samples)
    return counts, samples


@pytest.mark.parametrize("kind", ["parallel", "perspective"])
@pytest.mark.parametrize("shape", [(6, 8), (1, 5), (4, 1), (1, 1)])
def test_links_are_mutual_best_partners(kind, shape):
    source = small(kind, shape)
    texels, depth, slope, texel = ldi_twin.sample_lists(source)
    want = ldi_twin.link(texels, depth, slope, texel, GAP)
    _, _, links = linked(source)
    found = {(p, int(q), axis) for axis in range(2) for p, q in enumerate(links[axis]) if q >= 0}
    assert found == want
    back = {(int(q), p, axis) for axis in range(2) for p, q in enumerate(links[axis + 2]) if q >= 0}
    assert back == want


@pytest.mark.parametrize("kind", ["parallel", "perspective"])
@pytest.mark.parametrize("shape", [(6, 8), (1, 5), (4, 1), (1, 1)])
def test_groups_and_corners_equal_the_twin(kind, shape):
    source = small(kind, shape)
    depth, step, links = linked(source)
    counts, samples = grouped(source, links)
    corners, masks = np.empty((len(samples), 4), np.float32), np.empty(len(samples), np.uint8)
    patches.fill_corners(samples, depth, step, corners, masks)
    want = ldi_twin.patches_of_layers(source, GAP)
    assert counts.sum() == len(want)
    cells = np.repeat(np.arange(counts.size), counts.ravel())
    found = {}
    for cell, four, values, mask in zip(cells, samples, corners, masks, strict=True):
        r, c = divmod(int(cell), counts.shape[1])
        found[c - 1, r - 1, tuple(four)] = values, mask
    assert len(found) == len(want)
    for c, r, values, present, four in want:
        got, mask = found[c, r, tuple(four)]
        np.testing.assert_allclose(got, values, rtol=1e-5)
        assert mask == sum(1 << k for k in range(4) if present[k])


def test_a_layered_image_without_samples_has_no_patches():
    source = LayeredDepthImage(FRAME, np.zeros((3, 5), int), np.empty(0), np.empty((0, 3)), np.empty((0, 3)))
    depth, step, links = linked(source)
    counts, samples = grouped(source, links)
    assert links.shape == (4, 0)
    assert counts.shape == (4, 5)
    assert not counts.any()
    near, far = np.empty(0), np.empty(0)
    patches.fill_corners(samples, depth, step, np.empty((0, 4), np.float32), np.empty(0, np.uint8))
    patches.measure_patches(np.empty((0, 4), np.float32), np.empty(0, np.uint8), near, far)
    nodes = np.zeros(3, np.uint32)
    patches.pack_patches(np.full(3, -1, np.int32), near, far, 0.0, 1.0, nodes)
    assert (nodes == quadtree.EMPTY).all()


def range_by_grid(corners, mask):
    """Least and greatest of a bilinear patch over a grid of its valid quadrants."""
    s = np.linspace(0.0, 1.0, 5)
    q, p = np.meshgrid(s, s, indexing="ij")
    a, b, c, e = corners
    value = (a * (1 - p) + b * p) * (1 - q) + (c * (1 - p) + e * p) * q
    valid = np.zeros(value.shape, bool)
    for k in range(4):
        if mask & (1 << k):
            valid |= (abs(p - 0.25 - 0.5 * (k & 1)) <= 0.25) & (abs(q - 0.25 - 0.5 * (k >> 1)) <= 0.25)
    return value[valid].min(), value[valid].max()


def test_measured_and_packed_ranges_equal_a_scan():
    corners = np.random.default_rng(4).random((16, 4)).astype(np.float32) * 3
    masks = np.arange(16, dtype=np.uint8)
    near, far = np.empty(16), np.empty(16)
    patches.measure_patches(corners, masks, near, far)
    assert (near[0], far[0]) == (np.inf, -np.inf)
    for patch in range(1, 16):
        np.testing.assert_allclose((near[patch], far[patch]), range_by_grid(corners[patch].astype(float), patch))
    cells, nodes, low, scale = np.array([3, -1, 15, 7], np.int32), np.empty(4, np.uint32), -0.1, 65535 / 3.3
    patches.pack_patches(cells, near, far, low, scale, nodes)
    assert nodes[1] == quadtree.EMPTY
    for cell in (0, 2, 3):
        least, greatest = int(nodes[cell]) & 0xFFFF, int(nodes[cell]) >> 16
        assert least <= (near[cells[cell]] - low) * scale <= least + 1.02
        assert greatest - 1.02 <= (far[cells[cell]] - low) * scale <= greatest
