"""Pre-warped textures as such, and texels without displacement, which are free and stay where they are."""

from __future__ import annotations

import json

import numpy as np
import pytest
from click.testing import CliRunner

import ibrpipe
from ibrpipe.cli.main import cli
from ibrpipe.errors import RendererError
from ibrpipe.io.photos.images import read_image
from ibrpipe.modelling.relief_textures import asset_from_reliefs, box_from_mesh
from ibrpipe.renderers.prewarp.faces import sight
from ibrpipe.renderers.prewarp.renderer import visible_faces
from ibrpipe.renderers.prewarp.source import build_relief
from ibrpipe.synthetic.instanced.pieces import painted_box

N = 96


def bricks(sunken=0.04, base=0.0, n=N):
    """Flat bricks of height `base` in mortar that lies `sunken` deeper and waves."""
    y, x = np.mgrid[:n, :n] / n
    mortar = ((6 * y) % 1 < 0.25) | ((3 * x + 0.5 * (np.floor(6 * y) % 2)) % 1 < 0.12)
    height = np.where(mortar, base - sunken * (1 + 0.3 * np.sin(19 * x) * np.cos(17 * y)), base)
    color = 0.5 + 0.4 * np.stack([np.sin(20 * x), np.cos(17 * y), np.sin(12 * (x + y))], axis=2)
    frame = ibrpipe.ParallelFrame((0, 0, 0), (1 / n, 0, 0), (0, 1 / n, 0), (0, 0, 1))
    return ibrpipe.ReliefTexture(frame, color, height)


def camera(eye=(0.4, 0.3, 1.3), width=160, height=120):
    return ibrpipe.Camera.look_at(eye, (0.5, 0.5, 0), (0.1, 1, 0.2), 45, width, height)


@pytest.mark.parametrize("method", ["two-pass", "pipelined"])
@pytest.mark.parametrize("bits", [8, 32])
@pytest.mark.parametrize("eye", [(0.4, 0.3, 1.3), (0.1, -0.3, 1.0), (0.6, 0.5, -1.2)])
@pytest.mark.parametrize("base", [0.0, 0.3])
def test_a_wall_of_flat_bricks_is_seen_as_it_is(method, bits, eye, base):
    source, view = bricks(base=base), camera((*eye[:2], eye[2] + base))
    faces = visible_faces(build_relief(source), sight(source.frame, view))
    assert [face.at for face, _ in faces] == [pytest.approx(base, abs=1e-7)]
    got = ibrpipe.render(source, view, "prewarp", method=method, depth_bits=bits, level=0)
    want = ibrpipe.render(source, view, "ldi")
    both = np.isfinite(got.depth) & np.isfinite(want.depth)
    assert both.mean() > 0.3
    assert (np.isfinite(got.depth) != np.isfinite(want.depth)).mean() < 0.012
    depth = np.where(both, want.depth, 1.0)
    error = np.abs(np.where(both, got.depth, 1.0) - depth)
    assert np.quantile(error[both], 0.85) < 0.3 / N
    x, y, z = np.moveaxis(view.center + view.pixel_rays() * depth[..., None], -1, 0)
    inside = both & (np.abs(z - base) < 1e-6) & (np.abs(x - 0.5) < 0.45) & (np.abs(y - 0.5) < 0.45)
    assert np.quantile(error[inside], 0.9) < 1e-5  # flat texels do not move at all


@pytest.mark.parametrize("method", ["two-pass", "pipelined"])
def test_flat_chunks_change_nothing_but_time(method, monkeypatch):
    from ibrpipe.renderers.prewarp import passes

    source, view = bricks(n=130), camera()
    fast = ibrpipe.render(source, view, "prewarp", method=method, level=0)
    monkeypatch.setattr(passes, "_flat", lambda relief, face: passes._NONE8)
    slow = ibrpipe.render(source, view, "prewarp", method=method, level=0)
    np.testing.assert_array_equal(np.isfinite(fast.depth), np.isfinite(slow.depth))
    there = np.isfinite(fast.depth)
    assert np.isclose(fast.depth[there], slow.depth[there], atol=1e-6).mean() > 0.999


def test_which_texels_are_flat():
    relief = build_relief(bricks(n=192))
    assert relief.flat == 0.0
    level = relief.height == 0
    for row, chunk in ((0, 0), (80, 0), (80, 1), (88, 2), (100, 5)):
        want = level[row, 32 * chunk : 32 * chunk + 33].all()
        assert bool(relief.flat_chunks[row, chunk]) == want
    assert 0.05 < relief.flat_chunks.mean() < 0.9
    y, x = np.mgrid[:32, :32]
    wavy = ibrpipe.ReliefTexture(bricks().frame, np.zeros((32, 32, 3)), 0.01 * np.sin(x) * y)
    assert build_relief(wavy).flat is None
    assert build_relief(ibrpipe.ReliefTexture(wavy.frame, wavy.color, np.full((32, 32), np.nan))).flat is None


def mapped(texture, view):
    """Colour (h, w, 3) and alpha where a camera sees the rectangle of a texture: planar texture mapping, bilinear."""
    rows, columns = texture.alpha.shape
    normal = np.cross(texture.across, texture.down)
    rays = view.pixel_rays()
    t = ((texture.corner - view.center) @ normal) / (rays @ normal)
    local = view.center + t[..., None] * rays - texture.corner
    x = local @ texture.across / (texture.across @ texture.across) * columns - 0.5
    y = local @ texture.down / (texture.down @ texture.down) * rows - 0.5
    inside = (t > 0) & (x >= 0) & (y >= 0) & (x < columns - 1) & (y < rows - 1)
    i, j = np.floor(np.where(inside, x, 0)).astype(int), np.floor(np.where(inside, y, 0)).astype(int)
    p, q = (np.where(inside, x, 0) - i)[..., None], (np.where(inside, y, 0) - j)[..., None]
    values = np.concatenate([texture.color, texture.alpha[..., None]], axis=2)
    mixed = (1 - q) * ((1 - p) * values[j, i] + p * values[j, i + 1])
    mixed += q * ((1 - p) * values[j + 1, i] + p * values[j + 1, i + 1])
    return np.where(inside[..., None], mixed, 0.0)


@pytest.mark.parametrize("method", ["two-pass", "pipelined"])
@pytest.mark.parametrize("eye", [(0.4, 0.3, 1.3), (1.9, 0.4, 0.35), (0.45, -1.0, 0.3)])
def test_mapping_the_warped_texture_is_the_picture(method, eye):
    view = camera(eye)
    textures = ibrpipe.prewarp(bricks(), view, method=method, level=0)
    assert len(textures) == 1
    frame = ibrpipe.render(bricks(), view, "prewarp", method=method, level=0)
    found = mapped(textures[0], view)
    solid = (found[..., 3] > 0.999) & (frame.alpha == 1)
    assert solid.sum() > 0.8 * (frame.alpha == 1).sum() > 800
    error = np.abs(found[..., :3] - frame.color)[solid]
    assert np.quantile(error, 0.9) < 0.05
    assert error.mean() < 0.02


def test_quadrilaterals_of_a_box_are_textures_of_their_own():
    mesh = painted_box((0, 0, 0), (1, 2, 3), (1, 1, 1)).mesh
    source = asset_from_reliefs(box_from_mesh(mesh, 48), "abcdef", "box")
    view = ibrpipe.Camera.look_at((4, 5, 6), (0.5, 1, 1.5), (0, 0, 1), 40, 120, 90)
    textures = ibrpipe.prewarp(source, view)
    assert len(textures) == 3
    frame = ibrpipe.render(source, view, "prewarp")
    shown = np.max([mapped(each, view)[..., 3] for each in textures], axis=0)
    assert (frame.alpha == 1).sum() > 500
    assert (shown[frame.alpha == 1] > 0.5).mean() > 0.97
    assert len(ibrpipe.prewarp(source, view, quads="each")) >= 3


def test_rows_alone_have_moved_along_rows_alone():
    height = np.zeros((32, 32))
    height[8:24, 8:24] = 0.3
    color = np.zeros((32, 32, 3))
    color[12, 12] = 1.0
    frame = ibrpipe.ParallelFrame((0, 0, 0), (1 / 32, 0, 0), (0, 1 / 32, 0), (0, 0, 1))
    source, view = ibrpipe.ReliefTexture(frame, color, height), camera((1.2, 1.3, 1.5))
    (rows,) = ibrpipe.prewarp(source, view, "rows", level=0)
    (both,) = ibrpipe.prewarp(source, view, level=0)
    assert rows.color.shape[0] == 32
    bright = [np.unravel_index(each.color[..., 0].argmax(), each.alpha.shape) for each in (rows, both)]
    places = [each.corner + (i + 0.5) / each.alpha.shape[1] * each.across + (j + 0.5) / each.alpha.shape[0] * each.down
              for each, (j, i) in zip((rows, both), bright, strict=True)]  # fmt: skip
    moved = 12.5 / 32 - (np.array([1.2, 1.3]) - 12.5 / 32) * 0.3 / (1.5 - 0.3)
    np.testing.assert_allclose(places[0][:2], [moved[0], 12.5 / 32], atol=0.04)
    np.testing.assert_allclose(places[1][:2], moved, atol=0.04)


def test_wrong_calls_are_told():
    with pytest.raises(RendererError, match="stage is 'columns'"):
        ibrpipe.prewarp(bricks(), camera(), "columns")
    with pytest.raises(RendererError, match="filter 'area'"):
        ibrpipe.prewarp(bricks(), camera(), filter="area")
    with pytest.raises(RendererError, match="no option 'levels'"):
        ibrpipe.prewarp(bricks(), camera(), levels=1)
    assert ibrpipe.prewarp(bricks(), camera((0.5, 0.5, 1.0)).__class__.look_at((0.5, 0.5, 1), (0.5, 0.5, 9))) == ()


def test_the_command_writes_textures_and_where_they_lie(tmp_path):
    ibrpipe.write_asset(asset_from_reliefs([bricks()], ["wall"], "test"), tmp_path / "wall")
    path = "orbit:frames=2,width=60,height=40,up=y,elevation=60"
    words = ["relief", "prewarp", str(tmp_path / "wall"), "--path", path, "--level", "0"]
    words += ["--out", str(tmp_path / "out")]
    done = CliRunner().invoke(cli, words, catch_exceptions=False)
    assert done.exit_code == 0
    listed = json.loads((tmp_path / "out/prewarp.json").read_text())
    assert f"{len(listed)} pre-warped texture of 2 views" in done.output  # one view is from behind
    assert {each["view"] for each in listed} == {"orbit_0000"}
    for each in listed:
        pixels = read_image(tmp_path / "out" / each["file"])
        assert pixels.shape[2] == 4
        assert len(each["corner"]) == len(each["across"]) == len(each["down"]) == 3
    assert CliRunner().invoke(cli, [*words, "--stage", "rows"], catch_exceptions=False).exit_code == 0
