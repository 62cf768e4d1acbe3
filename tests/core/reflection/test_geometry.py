"""Where hits lie in their patches; free rays against one sheet of patches, kernel against trying every patch."""

from __future__ import annotations

import ldi_twin
import numpy as np
import pytest
import reflection_twin
from kernel_runs import on_all_thread_counts
from small_fields import depth_image, layers

from ibrpipe.core.reflection.geometry import place_hits, search_rays
from ibrpipe.core.reflection.model import TRAITS
from ibrpipe.renderers.fields import build_field
from ibrpipe.renderers.search.quadtree import build_sheets
from ibrpipe.renderers.view_dependence.mirror import matrix
from ibrpipe.types import LayeredDepthImage

SOURCES = {"layers": layers(), "wall": depth_image()}
BASE = 7


def nearest(source, rays, slack):
    """(N,) nearest t over all patches, their borders moved outward by `slack` cells; +inf = none."""
    frame, patches, front = ldi_twin.patches_of(source)
    best = np.full(len(rays), np.inf)
    for n, ray in enumerate(rays):
        P = ldi_twin.homogeneous(frame, ray[:3])
        Q = ldi_twin.homogeneous(frame, ray[:3] + ray[3:]) - P
        for column, row, depths, present, _ in patches:
            for t, good in ldi_twin.roots(P, Q, column + 0.5, row + 0.5, depths, present, front, slack):
                best[n] = min(best[n], float(t)) if good else best[n]
    return best


def rays_at(source, count=90):
    """Rays from before and behind the samples, most of them at these; some lie across."""
    rng = np.random.default_rng(8)
    frame = source.frame if isinstance(source, LayeredDepthImage) else source.camera
    if isinstance(source, LayeredDepthImage):
        columns, rows = source.shape[1], source.shape[0]
        at = rng.random((count, 2)) * (columns, rows)
        targets = frame.origin + at[:, :1] * frame.a + at[:, 1:] * frame.b + rng.uniform(1, 2.5, (count, 1)) * frame.f
        ahead = frame.f
    else:
        at = rng.random((count, 2)) * (frame.width, frame.height)
        targets = frame.center + rng.uniform(13.5, 15.5, (count, 1)) * frame.pixel_rays(at)
        ahead = frame.R[2]
    origins = targets - 5 * ahead / np.linalg.norm(ahead) + rng.normal(size=(count, 3))
    origins[::9] = targets[::9] + 3 * ahead + rng.normal(size=targets[::9].shape)
    return np.ascontiguousarray(np.c_[origins, 0.5 * (targets - origins)])


@pytest.mark.parametrize("name", SOURCES)
def test_rays_meet_the_nearest_front_of_the_sheets_and_others_are_not_looked_at(name):
    source = SOURCES[name]
    rays, sheets = rays_at(source), [each for each in build_sheets(build_field(source), BASE) if len(each.leaves[1])]
    chosen = np.flatnonzero(np.arange(len(rays)) % 10 != 4)

    def search():
        t, ids = np.full(len(rays), np.inf), np.full(len(rays), -1, np.int64)
        for sheet in sheets:
            pyramid = (sheet.nodes, sheet.meta, sheet.grid)
            search_rays(rays, chosen, matrix(sheet.pose), sheet.box, pyramid, sheet.leaves, sheet.base, t, ids)
        return t, ids

    t, ids = on_all_thread_counts(search)
    left_out = np.setdiff1d(np.arange(len(rays)), chosen)
    assert np.isinf(t[left_out]).all()
    larger, smaller = nearest(source, rays, 1e-6)[chosen], nearest(source, rays, -1e-6)[chosen]
    assert (t[chosen] >= larger * (1 - 1e-6)).all()
    assert (t[chosen] <= smaller * (1 + 1e-6)).all()
    assert 20 < np.isfinite(t).sum() < len(chosen) - 5
    assert ((ids >= BASE) == np.isfinite(t)).all()
    assert ((ids == -1) == np.isinf(t)).all()


def test_what_is_nearer_already_stays_and_no_rays_are_no_work():
    source = SOURCES["wall"]
    rays, (sheet, *_) = rays_at(source), build_sheets(build_field(source), BASE)
    arguments = (matrix(sheet.pose), sheet.box, (sheet.nodes, sheet.meta, sheet.grid), sheet.leaves, sheet.base)
    near, ids = np.full(len(rays), 1e-3), np.full(len(rays), 3, np.int64)
    search_rays(rays, np.arange(len(rays)), *arguments, near, ids)
    assert (near == 1e-3).all()
    assert (ids == 3).all()
    search_rays(rays, np.empty(0, np.int64), *arguments, near, ids)
    search_rays(rays[:0], np.empty(0, np.int64), *arguments, near[:0], ids[:0])


@pytest.mark.parametrize("count", [0, 1, 300])
def test_hits_lie_in_their_patch_and_have_the_normal_between_its_samples(count):
    rng = np.random.default_rng(3)
    records = np.zeros((9, 8), np.int32)
    records[:, 0], records[:, 1], records[:, 2] = rng.integers(0, 5, 9), rng.integers(0, 4, 9), np.arange(9) % 2
    records[:, 4:] = rng.integers(0, 12, (9, 4))
    records[:, 4:][rng.random((9, 4)) < 0.3] = -1
    records[8, 4:] = -1  # no sample
    poses = np.stack([np.eye(4), np.array([[4.0, 0, 3, 0], [0, 4.0, 2, 0], [0, 0, 0, -1], [0, 0, 1, 0]])])
    normals = rng.normal(size=(12, 3)).astype(np.float32)
    normals[5] = np.nan
    points, ids = rng.uniform(1, 4, (count, 3)), rng.integers(-1, 9, count)

    def place():
        traits, found = np.full((count, TRAITS), 7, np.float32), np.zeros((count, 3), np.float32)
        place_hits(points, ids, records, poses, normals, traits, found)
        return traits, found

    traits, found = on_all_thread_counts(place)
    assert (traits[:, 2:] == 7).all()
    for point, which, trait, normal in zip(points, ids, traits, found):
        if which < 0:
            assert (trait[:2] == 7).all()
            assert np.isnan(normal).all()
            continue
        record, (x, y, _, q) = records[which], poses[records[which, 2]] @ np.append(point, 1.0)
        at = np.clip((x / q - record[0], y / q - record[1]), 0, 1)
        np.testing.assert_allclose(trait[:2], at, atol=1e-6)
        weights = reflection_twin.corner_weights(record[4:], *at)
        samples = [] if weights is None else [(w, normals[n]) for w, n in zip(weights, record[4:]) if w > 0]
        mean = sum((w * each.astype(float) for w, each in samples), np.zeros(3)) if samples else np.full(3, np.nan)
        np.testing.assert_allclose(normal, mean / np.linalg.norm(mean), atol=1e-6)
