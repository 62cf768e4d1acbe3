"""What Python and notebooks show of the types: one short line each, and a picture."""

from __future__ import annotations

import numpy as np

import ibrpipe
from ibrpipe.types import (
    Asset,
    Camera,
    DepthImage,
    Frame,
    Instances,
    LayeredDepthImage,
    Light,
    Lighting,
    Mesh,
    PaintedMesh,
    ParallelFrame,
    Part,
    ReliefTexture,
    Scene,
    Texture,
)
from ibrpipe.types.layers import offsets_of
from ibrpipe.types.preview import front_picture
from ibrpipe.types.relief_mesh import ReliefMesh

CAMERA = Camera.look_at((0, -3, 1), (0, 0, 1), (0, 0, 1), 60, 64, 48)
TRIANGLE = Mesh(np.eye(3), [[0, 1, 2]])


def test_frame_says_its_size_and_what_it_holds() -> None:
    frame = Frame(np.zeros((480, 640, 3), np.float32), None, np.zeros((480, 640), np.float32))
    assert repr(frame) == "Frame(640 x 480: color, alpha)"
    assert repr(Frame(None, None, None)) == "Frame(empty)"


def test_asset_without_textures() -> None:
    assert repr(Asset(())) == "Asset(0 textures, view dependence: none)"


def test_channels_of_a_file_are_those_there_are_and_colour_is_times_alpha() -> None:
    color, alpha, depth = np.full((2, 3, 3), (0.2, 0.4, 0.8), np.float32), np.full((2, 3), 0.5), np.full((2, 3), 7.0)
    found = Frame(color, depth, alpha).channels
    assert {name: plane[1, 2] for name, plane in found.items()} == {
        "R": np.float32(0.1), "G": np.float32(0.2), "B": np.float32(0.4), "A": 0.5, "Z": 7.0,
    }  # fmt: skip
    assert list(Frame(None, depth, None).channels) == ["Z"]
    np.testing.assert_array_equal(Frame(color, None, None).channels["B"], color[..., 2])


def window(b: tuple[float, float, float], f: tuple[float, float, float]) -> LayeredDepthImage:
    """A wall of 2 x 3 texels along x; brighter from texel to texel, row by row; the second texel is empty."""
    counts = np.array([[1, 0, 2], [1, 1, 1]])
    offsets = offsets_of(counts)
    color = np.linspace(0.1, 0.6, 6)[:, None] * np.ones(3)
    frame = ParallelFrame((0, 0, 0), (1, 0, 0), b, f)
    depth = np.array([1, 1, 2, 1, 1, 1], np.float32)
    return LayeredDepthImage(frame, offsets, depth, color, np.full((6, 3), np.nan), np.array([1, 1, 1, 1, 0, 1]))


def test_every_public_type_is_told_in_one_short_line() -> None:
    layers = window((0, 0, -1), (0, 1, 0))
    copies = Instances("leaf", np.eye(4))
    part = Part("oak", (PaintedMesh(TRIANGLE, np.ones((3, 3))),), children=(copies,))
    told = [
        (CAMERA, "Camera(64 x 48, focal length 41.5692 pixels, at (0, -3, 1))"),
        (layers.frame, "ParallelFrame(origin (0, 0, 0), a (1, 0, 0), b (0, 0, -1), f (0, 1, 0))"),
        (layers, "LayeredDepthImage(3 x 2, 6 samples, parallel)"),
        (Texture(layers), "Texture(3 x 2, 6 samples, view dependence: none)"),
        (ibrpipe.SpiralTexture(layers), "SpiralTexture(3 x 2, 6 samples, view dependence: none)"),
        (ReliefTexture(layers.frame, np.zeros((2, 3, 3)), np.zeros((2, 3))), "ReliefTexture(3 x 2)"),
        (DepthImage(CAMERA, np.zeros((48, 64, 3)), np.ones((48, 64))), "DepthImage(64 x 48, at (0, -3, 1))"),
        (TRIANGLE, "Mesh(3 vertices, 1 triangles)"),
        (part.meshes[0], "PaintedMesh(Mesh(3 vertices, 1 triangles), matt)"),
        (copies, "Instances(1 of 'leaf')"),
        (part, "Part('oak', 1 meshes, 0 captured, 1 copies)"),
        (Scene([Part("leaf"), part], "oak"), "Scene('oak', 2 parts)"),
        (Light((0, 0, 2)), "Light(from (0, 0, 1), colour (1, 1, 1))"),
        (Lighting((0.3, 0.3, 0.3), ()), "Lighting(ambient (0.3, 0.3, 0.3), 0 lights)"),
        (
            ReliefMesh(TRIANGLE, np.array([[[0, 0], [1, 0], [0, 1.0]]]), np.ones((4, 5)), 0.1),
            "ReliefMesh(Mesh(3 vertices, 1 triangles), relief 5 x 4)",
        ),
    ]
    assert [repr(each) for each, _ in told] == [line for _, line in told]


def test_no_public_type_prints_its_arrays() -> None:
    for name in ibrpipe.__all__:
        kind = getattr(ibrpipe, name)
        if isinstance(kind, type) and hasattr(kind, "__dataclass_fields__"):
            # those that dataclasses make are wrapped, against types that hold themselves
            assert not hasattr(kind.__repr__, "__wrapped__"), name


def test_notebooks_show_a_picture_and_the_facts() -> None:
    asset = Asset((Texture(window((0, 0, -1), (0, 1, 0))),), {"units": "<b>mm</b>"})
    text = asset._repr_html_()
    assert 'src="data:image/png;base64,iVBOR' in text
    assert "&lt;b&gt;mm&lt;/b&gt;" in text
    assert "<b>mm" not in text
    assert "ibrpipe view FOLDER" in text
    assert "<img" not in Asset(())._repr_html_()


def test_the_picture_is_of_a_side() -> None:
    side, top = window((0, 0, -1), (0, 1, 0)), window((0, 1, 0), (0, 0, -1))
    pictures = [
        Asset(tuple(map(Texture, layers)))._repr_html_().split('src="')[1].split('"')[0]
        for layers in ([top, side], [side], [top])
    ]
    assert pictures[0] == pictures[1] != pictures[2]


def test_the_picture_is_upright_and_not_mirrored() -> None:
    grey = np.linspace(0.1, 0.6, 6).astype(np.float32)
    # of the third texel the nearer sample, and none where no photo sees it
    upright = np.array([[grey[0], 0, grey[1]], [grey[3], 0, grey[5]]])
    seen = front_picture(window((0, 0, -1), (0, 1, 0)))  # from the front, rows downward: as it lies in memory
    np.testing.assert_array_equal(seen.color[..., 0], upright)
    np.testing.assert_array_equal(seen.alpha, upright > 0)
    # rows upward, seen from the front: a and b are mirrored, rows turn round
    np.testing.assert_array_equal(front_picture(window((0, 0, 1), (0, 1, 0))).color[..., 0], upright[::-1])
    # rows upward, seen from the back: turned by half a turn
    np.testing.assert_array_equal(front_picture(window((0, 0, 1), (0, -1, 0))).color[..., 0], upright[::-1, ::-1])
