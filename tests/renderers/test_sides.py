"""Which side of a depth sample is surface: one rule for all searches and the oracle.

A depth image with its centre of projection inside an object (the globe of schaufler1999, fig. 10) is seen from outside
where its normals say so; without normals the surface is that on the side of the image plane.
"""

from __future__ import annotations

import ldi_twin
import numpy as np
import pytest

import ibrpipe
from ibrpipe.bench.oracles.fields import cast
from ibrpipe.bench.oracles.surface import build_surface
from ibrpipe.renderers.fields import build_field, faces_away
from ibrpipe.types import Camera, ParallelFrame
from ibrpipe.types.layers import single_layer

AXES = np.concatenate([np.eye(3), -np.eye(3)])
#: renderer and options, share of pixels that may be missing, and error of depth
SEARCHES = [
    ("ldi", {}, 0.02, 0.02), ("ldi", {"search": "quadtree"}, 0.02, 0.02), ("ldi", {"search": "patches"}, 0.02, 0.02),
    ("epipolar", {}, 0.02, 0.02), ("epipolar", {"search": "nearest"}, 0.02, 0.15),
    ("epipolar", {"search": "linear"}, 0.02, 0.15), ("splat", {}, 0.25, 0.06),
]  # fmt: skip


def looking(axis, pixels):
    return Camera.look_at((0, 0, 0), axis, (0, 0, 1) if abs(axis[2]) < 0.5 else (0, 1, 0), 92, pixels, pixels)


def ball(outward, pixels=64):
    """Six layered images from the middle of a ball of radius 1, normals outward, inward or (None) unknown."""
    found = []
    for axis in AXES:
        camera = looking(axis, pixels)
        rays = camera.pixel_rays()
        depth = 1.0 / np.linalg.norm(rays, axis=2)
        normal = None if outward is None else (1.0 if outward else -1.0) * rays * depth[..., None]
        color = (0.5 + 0.5 * rays * depth[..., None]).astype(np.float32)
        found.append(single_layer(camera, depth, color, None if normal is None else normal.astype(np.float32)))
    return found


def crossings(camera):
    """Camera depths (H, W) at which rays enter and leave the ball, both 0 for none."""
    rays, eye = camera.pixel_rays(), camera.center
    a, b, c = (rays**2).sum(-1), rays @ eye, eye @ eye - 1.0
    root = np.sqrt(np.maximum(b * b - a * c, 0.0))
    hit = b * b > a * c
    return np.where(hit, (-b - root) / a, 0.0), np.where(hit, (-b + root) / a, 0.0)


@pytest.mark.parametrize(("renderer", "options", "missing", "error"), SEARCHES)
@pytest.mark.parametrize("outward", [True, False, None])
@pytest.mark.parametrize("eye", [(2.2, -1.5, 1.2), (-0.2, 2.6, -0.7)])
def test_a_ball_round_its_centre_of_projection_is_seen_from_the_side_of_its_normals(
    renderer, options, missing, error, outward, eye
):
    camera = Camera.look_at(eye, (0, 0, 0), fov_y_deg=50, width=60, height=50)
    near, far = crossings(camera)
    wanted, other = (near, far) if outward else (far, near)
    found = ibrpipe.render(ball(outward), camera, renderer, **options).depth
    inside = far - near > 0.5
    assert inside.sum() > 300
    assert np.isfinite(found[inside]).mean() > 1 - missing
    there = inside & np.isfinite(found)
    found = np.where(there, found, 0.0)
    assert (np.abs(found - wanted)[there] < error).mean() > 0.98
    assert (np.abs(found - other)[there] < error).mean() < 0.01


@pytest.mark.parametrize("outward", [True, False])
def test_a_parallel_image_is_seen_from_the_side_of_its_normals(outward):
    frame = ParallelFrame((-1, -1, 0), (0.1, 0, 0), (0, 0.1, 0), (0, 0, 1))
    normal = np.tile(np.float32([0, 0, 1 if outward else -1]), (20, 20, 1))
    layers = single_layer(frame, np.full((20, 20), 0.4), np.ones((20, 20, 3)), normal)
    for z, seen in ((3.0, outward), (-3.0, not outward)):
        camera = Camera.look_at((0.1, 0.2, z), (0, 0, 0.4), (0, 1, 0), 40, 30, 30)
        for renderer in ("ldi", "epipolar", "splat"):
            for options in ({}, {"search": "nearest"}, {"search": "linear"}):
                if renderer == "epipolar" or not options:
                    depth = ibrpipe.render(layers, camera, renderer, **options).depth
                    assert (np.isfinite(depth).sum() > 200) == seen, (renderer, options, z)


@pytest.mark.parametrize("outward", [True, False])
def test_oracle_and_twin_know_the_side(outward):
    camera = Camera.look_at((2.1, -1.4, 1.1), (0, 0, 0), fov_y_deg=50, width=24, height=20)
    sources = ball(outward, 10)
    want = np.min([ldi_twin.cast(source, camera, 0.0) for source in sources], axis=0)
    pixels = camera.pixel_centers().reshape(-1, 2)
    depth = cast([build_surface(source) for source in sources], camera, pixels)[0].reshape(20, 24)
    found = ibrpipe.render(sources, camera, "ldi").depth
    for other in (depth, found):
        same = np.isclose(other, want, rtol=1e-4) | (np.isinf(other) & np.isinf(want))
        assert same.mean() > 0.98
    assert np.isfinite(want).sum() > 100


def test_layers_of_several_samples_and_unknown_normals_face_the_image():
    assert [faces_away(ball(outward, 6)[0]) for outward in (True, False, None)] == [True, False, False]
    pose = build_field(ball(True, 6)[0]).pose
    assert pose.away
    np.testing.assert_array_equal(pose.turned().turned().linear, pose.linear)
    assert pose.limited(0.5, 1.0, 0.1) == (0.4, 1.1)
    assert pose.limited(0.5, 1.0, 9.0) == (0.25, 10.0)
    assert pose.turned().limited(-1.0, -0.5, 9.0) == (-10.0, -0.25)
