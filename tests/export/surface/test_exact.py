"""Cases with an exact answer: a flat rectangle of random texels, tables at their cells, errors of known size."""

from __future__ import annotations

import json

import numpy as np
import pytest
import trimesh
from page_assets import light_of

import ibrpipe
from ibrpipe.core.color import srgb_decode, srgb_encode, to_bytes
from ibrpipe.core.reflection.directions import cell_directions, pad
from ibrpipe.export.glb import write
from ibrpipe.export.surface.colors import table_lights
from ibrpipe.export.surface.environment import surroundings
from ibrpipe.export.surface.fidelity import measure
from ibrpipe.export.surface.painter import paint, read_back
from ibrpipe.export.surface.settings import GltfOptions
from ibrpipe.io.photos.images import read_image, write_png
from ibrpipe.io.surfaces.gltf_file import GltfFile
from ibrpipe.io.surfaces.mesh_materials import read_textured
from ibrpipe.io.views import View
from ibrpipe.types import Camera, Frame, ParallelFrame
from ibrpipe.types.layers import offsets_of

ROWS, COLUMNS, TEXEL, MARGIN = 12, 20, 0.25, 3
CODES = np.random.default_rng(3).integers(0, 256, (ROWS, COLUMNS, 3)).astype(np.uint8)


def rectangle(codes: np.ndarray = CODES) -> ibrpipe.Asset:
    """A rectangle at z = 2 that faces -z, its corner at x = y = 0."""
    frame = ParallelFrame((0, 0, 0), (TEXEL, 0, 0), (0, TEXEL, 0), (0, 0, 1))
    color = srgb_decode(codes.reshape(-1, 3).astype(np.float32) / 255)
    count = len(color)
    layers = ibrpipe.LayeredDepthImage(
        frame,
        offsets_of(np.ones(codes.shape[:2], int)),
        np.full(count, 2.0),
        color,
        np.tile((0.0, 0.0, -1.0), (count, 1)),
    )
    return ibrpipe.Asset((ibrpipe.Texture(layers),), {"units": "m"})


def facing(distance: float = 5.0) -> Camera:
    """A camera whose pixels are the texels, with MARGIN more on all sides."""
    size = np.array([COLUMNS, ROWS]) + 2 * MARGIN
    focal = distance / TEXEL
    K = np.array([(focal, 0, size[0] / 2), (0, focal, size[1] / 2), (0, 0, 1)])
    eye = np.array([COLUMNS * TEXEL / 2, ROWS * TEXEL / 2, 2.0 - distance])
    return Camera(K, np.column_stack([np.eye(3), -eye]), *map(int, size))


def inner(picture: np.ndarray) -> np.ndarray:
    return picture[MARGIN:-MARGIN, MARGIN:-MARGIN]


def placed(path) -> np.ndarray:
    return np.array(GltfFile(path).json["asset"]["extras"]["ibrpipe"]["gltf_from_world"])


@pytest.mark.parametrize("tolerance", [0, 2])
@pytest.mark.parametrize("texture", ["png", "webp"])
def test_a_flat_rectangle_comes_back_texel_by_texel(tmp_path, tolerance, texture):
    ibrpipe.write_asset(rectangle(), tmp_path / "asset")
    options = GltfOptions(tolerance=tolerance, texture=texture, quality=100, measure=False)
    write(tmp_path / "asset", tmp_path / "x.glb", options)
    found = paint(read_back(tmp_path / "x.glb", placed(tmp_path / "x.glb")), facing(), 1)
    np.testing.assert_array_equal(inner(to_bytes(srgb_encode(found.color))), CODES)
    assert (inner(found.alpha) == 1).all()
    assert found.alpha.sum() == ROWS * COLUMNS  # nothing beyond the rim


def test_a_flat_rectangle_is_a_few_triangles_in_metres_and_its_normal_map_is_level(tmp_path):
    ibrpipe.write_asset(rectangle(), tmp_path / "asset")
    write(tmp_path / "asset", tmp_path / "x.glb", GltfOptions(material="lit", measure=False))
    (mesh,) = trimesh.load(tmp_path / "x.glb").geometry.values()
    # to the next texel centre on all sides; joined, corners may move by the tolerance, 2 texels, along the rim
    whole = (COLUMNS + 1) * (ROWS + 1) * TEXEL**2
    assert whole * (1 - 1e-6) < mesh.area < whole * (1 + 1e-6)
    assert len(mesh.faces) < 2 * (COLUMNS + ROWS)  # fewer than along the rim: the inside is joined
    normals = np.asarray(mesh.visual.material.normalTexture.convert("RGB")).reshape(-1, 3)
    assert np.unique(normals, axis=0).tolist() == [[128, 128, 255]]


def test_obj_and_ply_of_a_flat_rectangle_hold_its_codes_and_places(tmp_path):
    ibrpipe.export(rectangle(), tmp_path / "x.obj", tolerance=0)
    found = read_textured(tmp_path / "x.obj")
    world = found.mesh.vertices[found.mesh.faces].reshape(-1, 3) @ [(1, 0, 0), (0, 0, 1), (0, -1, 0)]  # z is up
    place = np.rint(world[:, :2] / TEXEL - 0.5).astype(int)
    np.testing.assert_allclose(world[:, :2], (place + 0.5) * TEXEL, atol=1e-6)
    inside = ((place >= 0) & (place < (COLUMNS, ROWS))).all(axis=1)
    column, row = np.floor(found.uv.reshape(-1, 2)[inside] * found.color.shape[1::-1]).astype(int).T
    codes = to_bytes(srgb_encode(found.color[row, column, :3]))
    np.testing.assert_array_equal(codes, CODES[place[inside, 1], place[inside, 0]])
    ibrpipe.export(rectangle(), tmp_path / "x.ply")
    mesh = trimesh.load(tmp_path / "x.ply", process=False)
    y, x = (np.indices((ROWS, COLUMNS)).reshape(2, -1) + 0.5) * TEXEL
    np.testing.assert_array_equal(mesh.vertices, np.stack([x, y, np.full(len(x), 2.0)], axis=1))
    np.testing.assert_array_equal(mesh.visual.vertex_colors[:, :3], CODES.reshape(-1, 3))
    assert len(mesh.faces) == 2 * (COLUMNS - 1) * (ROWS - 1)
    assert mesh.area == pytest.approx((COLUMNS - 1) * (ROWS - 1) * TEXEL**2)


@pytest.mark.parametrize("side", [1, 2, 3, 6])
def test_small_charts_keep_their_area_whatever_the_tolerance(tmp_path, side):
    ibrpipe.export(rectangle(CODES[:side, :side]), tmp_path / "x.glb", tolerance=16, measure=False)
    (mesh,) = trimesh.load(tmp_path / "x.glb").geometry.values()
    assert len(mesh.faces) == 2
    assert mesh.area == pytest.approx(((side + 1) * TEXEL) ** 2, rel=1e-6)


def test_one_sample_alone_is_a_vertex(tmp_path):
    assert ibrpipe.export(rectangle(CODES[:1, :1]), tmp_path / "x.ply").startswith("1 vertices, 0 triangles")


def test_tables_give_their_cells_light_at_the_cells_directions():
    light = light_of()
    for table, padded in zip(light.tables, pad(light.tables)):
        found = table_lights(padded, cell_directions(table.shape[0]).reshape(-1, 3))
        np.testing.assert_allclose(found, table.reshape(-1, 3), atol=1e-6)


def test_surroundings_hold_the_tables_light_of_every_pixels_direction(tmp_path):
    light = light_of()
    turn = np.array([(1.0, 0, 0, 5), (0, 0, 1, 6), (0, -1, 0, 7), (0, 0, 0, 1)])  # z up becomes y up
    for content, padded in zip(surroundings(light, turn), pad(light.tables)):
        (tmp_path / "x.hdr").write_bytes(content)
        picture = read_image(tmp_path / "x.hdr")
        height, width = picture.shape[:2]
        v, u = (np.indices((height, width)) + 0.5) / np.array([height, width])[:, None, None]
        around, down = 2 * np.pi * (u - 0.5), np.pi * v
        axes = np.stack([np.sin(down) * np.cos(around), np.cos(down), np.sin(down) * np.sin(around)], axis=-1)
        wanted = table_lights(padded, axes.reshape(-1, 3) @ turn[:3, :3]).reshape(picture.shape)
        # Radiance HDR: 8 bits of the greatest of three channels, whose code is 128 at least
        assert (np.abs(picture - wanted) <= wanted.max(axis=2, keepdims=True) / 128).all()


@pytest.mark.parametrize("off", [0, 10])
def test_an_error_of_known_size_is_found(tmp_path, off):
    asset, camera = rectangle(np.full_like(CODES, 100)), facing()
    truth = ibrpipe.render(asset, camera, samples=4)
    write_png(tmp_path / "photo.png", truth.color)
    lost = 4

    def draw(view: Camera) -> Frame:
        frame = ibrpipe.render(asset, view, outputs=("color", "alpha"), samples=4)
        color = np.where(frame.alpha[..., None] > 0, srgb_decode(np.float32((100 + off) / 255)), 0).astype(np.float32)
        alpha = frame.alpha.copy()
        alpha[:, : MARGIN + lost] = 0
        return Frame(color, None, alpha)

    covered = int((truth.alpha >= 0.5).sum())
    assert covered == ROWS * COLUMNS
    found = measure(draw, asset, [View("photo", camera, tmp_path / "photo.png")], True, [])
    shade = 100.0 if off == 0 else 20 * np.log10(255 / off)
    whole = camera.width * camera.height
    assert (found.views, found.held_out) == (1, True)
    assert found.asset_db == pytest.approx(shade, abs=1e-6)
    assert found.coverage == pytest.approx(lost / COLUMNS)
    assert found.photos_db == pytest.approx(min(100.0, shade + 10 * np.log10(whole / covered)), abs=1e-6)
    assert found.asset_photos_db == 100.0
    assert json.loads(json.dumps(found.record()))["asset_db"] == round(found.asset_db, 4)
    assert "against held-out photos, the asset 100.0" in found.told()
