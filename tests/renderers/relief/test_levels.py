"""Mip maps of heights in renderer `relief`: height fields and meshes."""

from __future__ import annotations

import numpy as np
import pytest

import ibrpipe
from ibrpipe.renderers.relief.height_fields import build_field
from ibrpipe.types import Mesh, ParallelFrame

QUAD = Mesh(np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], float), np.array([[0, 1, 2], [0, 2, 3]]))
UV = np.array([[[0, 1], [1, 1], [1, 0]], [[0, 1], [1, 0], [0, 0]]], float)


def field(height):
    rows, columns = height.shape
    color = np.stack([height, 1 - height, 0 * height + 0.5], axis=2)
    frame = ParallelFrame((0, 1, 0), (1 / columns, 0, 0), (0, -1 / rows, 0), (0, 0, 1))
    return ibrpipe.ReliefTexture(frame, color, 0.2 * height)


def heights(rows, columns, seed=2):
    return np.random.default_rng(seed).random((rows, columns))


def camera(distance=1.6, width=60, height=45):
    return ibrpipe.Camera.look_at((0.4, 0.2, distance), (0.5, 0.5, 0.1), (0, 1, 0), 45, width, height)


@pytest.mark.parametrize("search", ["exact", "linear-binary"])
def test_a_level_is_the_averaged_field_where_it_was(search):
    fine = heights(16, 20)
    coarse = fine.reshape(8, 2, 10, 2).mean(axis=(1, 3))
    found = ibrpipe.render(field(fine), camera(), "relief", search=search, level=1)
    want = ibrpipe.render(field(coarse), camera(), "relief", search=search)
    np.testing.assert_array_equal(np.isfinite(found.depth), np.isfinite(want.depth))
    there = np.isfinite(want.depth)
    assert there.mean() > 0.2
    np.testing.assert_allclose(found.depth[there], want.depth[there], rtol=1e-5)
    np.testing.assert_allclose(found.color, want.color, atol=1e-4)
    assert not np.allclose(found.depth[there], ibrpipe.render(field(fine), camera(), "relief").depth[there], rtol=1e-4)


def test_holes_are_averaged_over_what_is_there():
    fine = heights(8, 8)
    fine[2, 3] = np.nan
    fine[4:6, 4:6] = np.nan
    level = build_field(field(np.nan_to_num(fine))).level(1).height
    holed = build_field(ibrpipe.ReliefTexture(field(np.zeros((8, 8))).frame, np.zeros((8, 8, 3)), fine)).level(1).height
    assert np.isnan(holed).sum() == 1
    assert holed[1, 1] == pytest.approx(np.nanmean(fine[2:4, 2:4]))
    assert holed[0, 0] == pytest.approx(5 * level[0, 0], rel=1e-5)


def test_the_level_follows_the_size_in_the_picture():
    whole = build_field(field(heights(256, 256)))
    levels = [whole.suited_level(camera(distance, 64, 64)) for distance in (1.2, 4.0, 16.0, 64.0)]
    assert levels == sorted(levels)
    assert levels[0] >= 1
    assert levels[-1] - levels[1] == pytest.approx(4, abs=1)
    assert whole.suited_level(camera(1.2, 1024, 1024)) == 0
    far = camera(30.0, 64, 64)
    prepared = ibrpipe.prepare(field(heights(256, 256)), "relief")
    truth = ibrpipe.render(prepared, far, "relief", samples=64).color
    shown = np.isfinite(ibrpipe.render(prepared, far, "relief").depth)
    errors = [np.abs(ibrpipe.render(prepared, far, "relief", level=level).color - truth)[shown].mean()
              for level in (0, "auto")]  # fmt: skip
    assert errors[1] < 0.5 * errors[0]


@pytest.mark.parametrize("model", ["flat", "shell"])
@pytest.mark.parametrize("edges", ["wrap", "cut"])
def test_heights_of_meshes_have_levels(model, edges):
    fine = heights(16, 16)
    coarse = fine.reshape(8, 2, 8, 2).mean(axis=(1, 3))
    normal = np.tile(np.float32([0, 0, 1]), (4, 4, 1))
    view = ibrpipe.Camera.look_at((0.3, -1.5, 2.5), (0, 0, 0), fov_y_deg=45, width=60, height=45)
    parts = [ibrpipe.ReliefMesh(QUAD, UV, each, 0.2, normal=normal, edges=edges) for each in (fine, coarse)]
    found = ibrpipe.render(parts[0], view, "relief", model=model, level=1)
    want = ibrpipe.render(parts[1], view, "relief", model=model)
    there = np.isfinite(want.depth)
    np.testing.assert_array_equal(np.isfinite(found.depth), there)
    np.testing.assert_allclose(found.depth[there], want.depth[there], rtol=1e-5)
    assert there.mean() > 0.2


def test_meshes_choose_levels_too():
    source = ibrpipe.ReliefMesh(QUAD, UV, heights(256, 256), 0.1)
    prepared = ibrpipe.prepare(source, "relief")
    (part,) = prepared.data.parts
    view = lambda distance: ibrpipe.Camera.look_at((0, 0, distance), (0, 0, 0), (0, 1, 0), 45, 64, 64)  # noqa: E731
    levels = [part.suited_level(view(distance)) for distance in (2.0, 8.0, 32.0)]
    assert np.diff(levels).tolist() == [2, 2]
    auto, own = (ibrpipe.render(prepared, view(8.0), "relief", level=level) for level in ("auto", levels[1]))
    np.testing.assert_array_equal(auto.depth, own.depth)
