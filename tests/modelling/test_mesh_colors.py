"""Colours of meshes in what is sampled from them: vertex colours, and textures filtered to the texel."""

from __future__ import annotations

import numpy as np
import pytest

from ibrpipe.errors import ShapeError, ValueRangeError
from ibrpipe.modelling.depth_images import depth_images_asset
from ibrpipe.modelling.dual_relief import dual_relief_from_mesh
from ibrpipe.modelling.frusta import Frustum
from ibrpipe.modelling.relief_textures import Plane, box_from_mesh, relief_from_mesh, reliefs_from_range
from ibrpipe.types import Camera, DepthImage, Mesh
from ibrpipe.types.mesh import MeshColors

#: a rectangle of 2 x 1 whose texture lies upright as seen from above (v downward)
FACES = np.array([[0, 1, 2], [0, 2, 3]])
QUAD = Mesh(np.array([[0, 0, 0], [2, 0, 0], [2, 1, 0], [0, 1, 0]], float), FACES)
UV = np.array([[0, 1], [1, 1], [1, 0], [0, 0]], float)[FACES]
WHITE = np.ones((2, 3, 3))


def noise(rows, columns, seed=0):
    return np.random.default_rng(seed).random((rows, columns, 3)).astype(np.float32)


def upward(relief):
    """Colours with rows from y = 1 downward, whatever way the frame's rows run."""
    return relief.color[::-1] if relief.frame.b[1] > 0 else relief.color


def test_texels_of_the_size_of_the_texture_are_the_texture():
    picture = noise(16, 32)
    colors = MeshColors(WHITE, UV, (picture,))
    np.testing.assert_allclose(upward(relief_from_mesh(QUAD, "+z", 32, colors)), picture, atol=1e-4)


def test_coarser_texels_are_means_of_what_they_cover():
    picture = noise(16, 32)
    found = upward(relief_from_mesh(QUAD, "+z", 8, MeshColors(WHITE, UV, (picture,))))
    np.testing.assert_allclose(found, picture.reshape(4, 4, 8, 4, 3).mean(axis=(1, 3)), atol=1e-4)


def test_a_texture_is_filtered_more_across_a_slope_than_along_it():
    steep = Mesh(QUAD.vertices * (1, 1, 0) + QUAD.vertices[:, :1] * (0, 0, 3.0), FACES)  # rises 6 over 2
    stripes = np.ones((32, 256, 3), np.float32) * (np.arange(32) % 2)[:, None, None]  # vary along the rows alone
    found = relief_from_mesh(steep, "+z", 64, MeshColors(WHITE, UV, (stripes,)))
    assert np.ptp(found.color[..., 0], axis=0)[2:-2].min() > 0.9  # isotropic filtering would leave grey


def test_colours_of_corners_are_interpolated_and_multiply_the_texture():
    ramp = QUAD.vertices[FACES][..., :1] / 2 * (1.0, 0.5, 0.25)
    plain = upward(relief_from_mesh(QUAD, "+z", 16, MeshColors(ramp)))
    want = ((np.arange(16) + 0.5) / 16)[None, :, None] * np.array([1.0, 0.5, 0.25])
    np.testing.assert_allclose(plain, np.broadcast_to(want, plain.shape), atol=1e-5)
    half = MeshColors(ramp, UV, (np.full((2, 2, 3), 0.5, np.float32),))
    np.testing.assert_allclose(upward(relief_from_mesh(QUAD, "+z", 16, half)), 0.5 * plain, atol=1e-5)


def test_each_face_has_its_own_texture():
    red, blue = (np.full((1, 1, 3), 1.0, np.float32) * tint for tint in ((1, 0, 0), (0, 0, 1)))
    colors = MeshColors(WHITE, UV, (red, blue), np.array([0, 1]))
    found = upward(relief_from_mesh(QUAD, "+z", 32, colors))
    np.testing.assert_allclose(found[-2, -4], (1, 0, 0))
    np.testing.assert_allclose(found[1, 3], (0, 0, 1))
    none = MeshColors(WHITE * 0.3, UV, (red,), np.array([0, -1]))
    np.testing.assert_allclose(upward(relief_from_mesh(QUAD, "+z", 32, none))[1, 3], 0.3, atol=1e-6)


def test_sides_of_a_box_are_coloured_like_its_one_side():
    lifted = Mesh(np.concatenate([QUAD.vertices, [[0, 0, -1]]]), np.concatenate([FACES, [[0, 1, 4]]]))
    corner = np.concatenate([WHITE, np.full((1, 3, 3), 0.2)])
    six = box_from_mesh(lifted, 16, MeshColors(corner))
    np.testing.assert_array_equal(six[4].color, relief_from_mesh(lifted, "+z", 16, MeshColors(corner)).color)
    assert np.nanmax(np.where(np.isfinite(six[2].height), six[2].color[..., 0], np.nan)) <= 1.0


def test_depth_images_are_filtered_to_their_pixels():
    picture = noise(64, 128)
    frustum = Frustum(eye=(1, 0.5, 0.5), target=(1, 0.5, 0), up=(0, 1, 0), fov=90)  # sees exactly the middle half
    asset = depth_images_asset(QUAD, [frustum], 16, "quad", MeshColors(WHITE, UV, (picture,)))
    found = asset.textures[0].layers.color.reshape(16, 16, 3)
    want = picture[:, 32:96].reshape(16, 4, 16, 4, 3).mean(axis=(1, 3))
    np.testing.assert_allclose(found, want, atol=1e-3)


def test_range_data_is_filtered_to_the_planes_texels():
    camera = Camera.look_at((0, 0, 4), (0, 0, 0), (0, 1, 0), np.degrees(2 * np.arctan(0.25)), 32, 32)
    photo = noise(32, 32)
    image = DepthImage(camera, photo, np.full((32, 32), 4.0))
    size = 2 * 24 / 32  # the middle 24 x 24 pixels, by 6 x 6 texels
    corner = np.array([-size / 2, size / 2, 1.0])
    plane = Plane(corner, np.array([size, 0, 0]), np.array([0, -size, 0]), 6, 6)
    relief = reliefs_from_range([image], [plane])[0]
    np.testing.assert_allclose(relief.color, photo[4:28, 4:28].reshape(6, 4, 6, 4, 3).mean(axis=(1, 3)), atol=1e-4)


def test_a_dual_relief_has_the_colours_of_its_front():
    box = Mesh(np.concatenate([QUAD.vertices, QUAD.vertices - (0, 0, 1)]), np.concatenate([FACES, FACES[:, ::-1] + 4]))
    corner = np.concatenate([np.full((2, 3, 3), 0.7), np.full((2, 3, 3), 0.1)])
    source = dual_relief_from_mesh(box, "+z", 24, MeshColors(corner))
    there = source.height > source.back
    np.testing.assert_allclose(source.color[there], 0.7, atol=1e-6)
    assert there.sum() > 100
    assert dual_relief_from_mesh(box, "+z", 24).color is None


def test_colours_that_do_not_fit_are_refused():
    with pytest.raises(ShapeError, match="corner must be"):
        MeshColors(np.ones((2, 3, 4)))
    with pytest.raises(ShapeError, match="uv must be"):
        MeshColors(WHITE, UV[:1], (noise(2, 2),))
    with pytest.raises(ShapeError, match="from -1 to 0"):
        MeshColors(WHITE, UV, (noise(2, 2),), np.array([0, 1]))
    with pytest.raises(ValueRangeError, match="uv holds NaN"):
        MeshColors(WHITE, UV * np.nan, (noise(2, 2),))
