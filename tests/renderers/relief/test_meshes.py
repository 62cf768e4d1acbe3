"""Relief mapping on meshes against brute force in float64, and what must hold whatever the mesh."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import relief_mesh_twin as twin

import ibrpipe
from ibrpipe import Camera, ReliefMesh
from ibrpipe.types import Mesh, ParallelFrame, ReliefTexture

QUAD = Mesh(np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], float), np.array([[0, 1, 2], [0, 2, 3]]))
QUAD_UV = np.array([[[0, 1], [1, 1], [1, 0]], [[0, 1], [1, 0], [0, 0]]], float)


def rough(shape, seed=3):
    return np.random.default_rng(seed).random(shape).astype(np.float32)


def quad(height, repeat=1.0, **more):
    return ReliefMesh(QUAD, QUAD_UV * repeat, height, more.pop("thickness", 0.4), **more)


def dome(n=5, repeat=2.0):
    """A bent sheet with shared vertices."""
    y, x = np.mgrid[: n + 1, : n + 1] / n
    places = np.stack([2 * x - 1, 2 * y - 1, 0.5 - (x - 0.5) ** 2 - 0.7 * (y - 0.5) ** 2], -1).reshape(-1, 3)
    i = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).ravel()
    faces = np.concatenate([np.stack([i, i + 1, i + n + 2], 1), np.stack([i, i + n + 2, i + n + 1], 1)])
    return Mesh(places, faces), repeat * np.stack([x, 1 - y], -1).reshape(-1, 2)[faces]


def camera(eye=(0.8, -1.5, 1.1), size=(24, 18), target=(0, 0, -0.1), fov=50.0):
    return Camera.look_at(eye, target, width=size[0], height=size[1], fov_y_deg=fov)


def check(source, view, flips=0.01, rtol=1e-6, **search):
    names = {"steps": "linear_steps", "halvings": "binary_steps", "least": "least_steps"}
    wanted, _ = twin.cast(source, view, **search)
    frame = ibrpipe.render(source, view, "relief", **{names.get(key, key): value for key, value in search.items()})
    assert not np.isnan(frame.depth).any()
    assert np.isfinite(frame.color).all()
    same = np.isclose(frame.depth, wanted, rtol=rtol)
    assert np.isfinite(wanted).any()
    assert np.mean(~same) <= flips
    np.testing.assert_array_equal(frame.alpha > 0, np.isfinite(frame.depth))
    return frame


@pytest.mark.parametrize("shape", [(8, 8), (7, 5), (1, 1), (1, 6), (13, 3)])
@pytest.mark.parametrize("edges", ["wrap", "cut"])
def test_exact_search_equals_brute_force(shape, edges):
    for eye in ((0.8, -1.5, 1.1), (-0.2, 0.3, 2.5)):
        check(quad(rough(shape), 1.0 if edges == "cut" else 2.5, edges=edges), camera(eye))


def test_bent_mesh_scaled_mirrored_and_degenerate_texture_coordinates():
    mesh, uv = dome()
    view = camera((0.8, -1.9, 1.3))
    for change in (uv, uv * (-1, 1), uv * (3, 0.25), uv @ np.array([[0.8, 0.5], [-0.3, 1.1]])):
        check(ReliefMesh(mesh, change, rough((6, 9)), 0.15), view, rtol=3e-6)
    uv = uv.copy()
    uv[7], uv[20, 1] = uv[7, 0], uv[20, 0]
    uv[30] = uv[30] * (-1, 1)
    check(ReliefMesh(mesh, uv, rough((6, 9)), 0.15), view, rtol=3e-6)


def test_dual_depth_equals_brute_force():
    height = 0.5 + 0.5 * rough((9, 9))
    back = 0.9 * rough((9, 9), 4)
    height[2:4, 5:8], back[2:4, 5:8] = 0.0, 1.0  # nothing there
    source = quad(height, edges="cut", back=back, thickness=0.8)
    frame = check(source, camera((0.6, -0.8, 1.9), size=(28, 22)))
    single = ibrpipe.render(replace(source, back=None), camera((0.6, -0.8, 1.9), size=(28, 22)), "relief")
    assert frame.alpha.sum() < single.alpha.sum()
    check(source, camera((0.6, -0.8, 1.9)), search="linear-binary", steps=24, least=24)


def test_published_search_equals_its_twin():
    mesh, uv = dome()
    view = camera((0.8, -1.9, 1.3))
    for search in ({"steps": 32, "halvings": 8}, {"steps": 7, "halvings": 3, "least": 7}, {"steps": 1, "halvings": 0}):
        check(ReliefMesh(mesh, uv, rough((6, 9)), 0.2), view, search="linear-binary", rtol=3e-6, **search)


def test_published_search_misses_a_spike_that_the_exact_one_finds():
    height = np.zeros((64, 64), np.float32)
    height[32, 32] = 1.0
    view = camera((0.0, -3.0, 0.8), size=(36, 30), target=(0, 0, -0.3), fov=10)
    exact = check(quad(height, edges="cut"), view, flips=0.005)
    steps = ibrpipe.render(
        quad(height, edges="cut"), view, "relief", search="linear-binary", linear_steps=8, least_steps=8
    )
    assert (exact.depth < steps.depth - 0.05).sum() > 5


@pytest.mark.parametrize("kind", ["zero", "one", "half", "pit", "step"])
def test_hard_heights_and_grazing_views(kind):
    height = np.full((6, 6), {"zero": 0.0, "one": 1.0}.get(kind, 0.5), np.float32)
    if kind == "pit":
        height[:], height[3, 3] = 1.0, 0.0
    if kind == "step":
        height[:, 3:] = 1.0
    for degrees in (0.0, 45.0, 85.0, 89.0, 89.9):
        turn = np.radians(degrees)
        view = camera((1.3 * np.sin(turn), 0.0, 1.3 * np.cos(turn)), size=(16, 13), target=(0, 0, 0), fov=30)
        check(quad(height, thickness=0.05), view, flips=0.03, rtol=1e-5)


def test_rays_along_axes_and_through_texel_corners():
    K = [[12, 0, 6.0], [0, 12, 6.0], [0, 0, 1]]
    R = np.diag([1.0, -1.0, -1.0])
    for shift in (0.0, 0.125, 0.0625):
        eye = np.array([shift, shift, 1.5])
        view = Camera(K, np.concatenate([R, (-R @ eye)[:, None]], 1), 13, 13)
        for edges in ("wrap", "cut"):
            check(quad(rough((16, 16)), edges=edges), view, flips=0.02)


@pytest.mark.parametrize(("scale", "away"), [(1e-6, 0.0), (1e6, 0.0), (1.0, 1e6)])
def test_far_and_tiny_scenes(scale, away):
    move = np.array([away, -away, away])
    mesh = Mesh(QUAD.vertices * scale + move, QUAD.faces)
    source = ReliefMesh(mesh, QUAD_UV, rough((8, 8)), 0.4 * scale)
    view = Camera.look_at(move + scale * np.array([0.8, -1.5, 1.1]), move, width=24, height=18)
    check(source, view, flips=0.02, rtol=2e-6)


def test_nearest_relief_wins_though_its_polygon_lies_behind():
    """The relief of a near polygon is deep, that of the one close behind it is flat: the second shows."""
    two = Mesh(
        np.concatenate([QUAD.vertices, QUAD.vertices - (0, 0, 0.2)]), np.concatenate([QUAD.faces, QUAD.faces + 4])
    )
    height = np.zeros((4, 4), np.float32)
    height[:, 2:] = 1.0
    uv = np.concatenate([QUAD_UV * 0.01 + 0.2, QUAD_UV * 0.01 + 0.7])
    check(ReliefMesh(two, uv, height, 0.4), camera(), flips=0.0)


def test_interpenetration_with_other_sources_and_frames():
    source = quad(rough((16, 16)), edges="cut")
    plate = ReliefTexture(
        ParallelFrame((-1, -1, 0), (0.25, 0, 0), (0, 0.25, 0), (0, 0, 1)),
        np.tile(np.float32([1, 0, 0]), (8, 8, 1)),
        np.full((8, 8), -0.2, np.float32),
    )
    view = camera(size=(48, 36))
    both = ibrpipe.render([source, plate], view, "relief")
    one, other = (ibrpipe.render(each, view, "relief") for each in (source, plate))
    np.testing.assert_array_equal(both.depth, np.minimum(one.depth, other.depth))
    joined = ibrpipe.composite([one, other])
    np.testing.assert_array_equal(joined.depth, both.depth)
    np.testing.assert_array_equal(joined.color, both.color)
    plate_wins = other.depth < one.depth
    assert 20 < plate_wins.sum() < 0.9 * np.isfinite(both.depth).sum()
    np.testing.assert_allclose(both.color[plate_wins], [[1, 0, 0]] * plate_wins.sum(), atol=1e-6)
    with pytest.raises(ibrpipe.IbrError, match="needs at least one frame"):
        ibrpipe.composite([])
    with pytest.raises(ibrpipe.IbrError, match="differ in size"):
        ibrpipe.composite([one, ibrpipe.render(plate, camera(), "relief")])


def test_baselines():
    source = quad(np.full((8, 8), 0.5, np.float32), thickness=0.4, color=rough((32, 32, 3)))
    view = camera(size=(40, 30))
    flat = ibrpipe.render(source, view, "relief", mapping="plain", anisotropy=0)
    bump = ibrpipe.render(source, view, "relief", mapping="bump", anisotropy=0)
    np.testing.assert_array_equal(flat.color, bump.color)
    parallax = ibrpipe.render(source, view, "relief", mapping="parallax", anisotropy=0)
    relief = ibrpipe.render(source, view, "relief", anisotropy=0)
    np.testing.assert_allclose(parallax.color, relief.color, atol=1e-5)  # a constant height: the shift is exact
    np.testing.assert_array_equal(parallax.depth, flat.depth)
    hit = np.isfinite(flat.depth)
    assert (relief.depth[hit] > flat.depth[hit] + 0.1).all()


def test_light_by_hand_on_a_flat_polygon():
    source = quad(np.ones((4, 4), np.float32), color=np.full((1, 1, 3), 0.5, np.float32))
    view = camera((0, 0.01, 2.0), size=(9, 9), target=(0, 0, 0))
    lit = ibrpipe.render(source, view, "relief", light=(0, 0, 1, 0), ambient=0.2, diffuse=0.6, specular=0.0)
    np.testing.assert_allclose(lit.color[lit.alpha > 0], 0.5 * 0.8, rtol=1e-5)
    slant = ibrpipe.render(source, view, "relief", light=(1, 0, 1, 0), ambient=0.2, diffuse=0.6, specular=0.0)
    np.testing.assert_allclose(slant.color[lit.alpha > 0], 0.5 * (0.2 + 0.6 * np.sqrt(0.5)), rtol=1e-5)
    dark = ibrpipe.render(source, view, "relief", light=(1, 0, -1, 0), ambient=0.2)
    np.testing.assert_allclose(dark.color[lit.alpha > 0], 0.5 * 0.2, rtol=1e-5)


def test_shadow_edge_lies_where_a_wall_casts_it():
    """A wall of height 0.4 along the rows, light at 45 degrees: the ground is dark for 0.4 beyond it."""
    height = np.zeros((8, 200), np.float32)
    height[:, :60] = 1.0
    source = quad(height, edges="cut", normal=np.tile(np.float32([0, 0, 1]), (8, 200, 1)))
    view = camera((0, 0.01, 4.0), size=(160, 20), target=(0, 0, -0.4), fov=4)
    for search in ("exact", "linear-binary"):
        lit = ibrpipe.render(source, view, "relief", light=(-1, 0, 1, 0), specular=0.0, search=search)
        row = lit.color[10, :, 0]
        dark = np.flatnonzero((row < 0.6 * row.max()) & (lit.alpha[10] > 0))[::-1]  # columns run toward -x
        place = view.center + lit.depth[10, dark[-1]] * (view.world_from_pixel @ (dark[-1] + 0.5, 10.5, 1.0))
        assert abs(place[0] - (-0.4 + 0.4)) < (0.02 if search == "exact" else 0.08)
        bright = ibrpipe.render(source, view, "relief", light=(-1, 0, 1, 0), specular=0.0, shadows=False)
        assert bright.color[10, dark[-1], 0] > 0.9 * row.max()


def test_normals_of_heights_and_of_a_normal_map_agree():
    height = (0.5 + 0.3 * np.sin(2 * np.pi * np.arange(64) / 64)).astype(np.float32) * np.ones((64, 1), np.float32)
    slope = 0.5 * (np.roll(height, -1, 1) - np.roll(height, 1, 1)) * 64 * 0.2 / 2.0  # thickness 0.2 over a side of 2
    normal = np.stack([-slope, np.zeros_like(slope), np.ones_like(slope)], -1)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    source, view = quad(height, thickness=0.2), camera(size=(40, 30))
    one, other = (ibrpipe.render(s, view, "relief", light=(1, 2, 3)) for s in (source, replace(source, normal=normal)))
    np.testing.assert_allclose(one.color, other.color, atol=4e-3)


def test_mip_maps_calm_what_is_far_away():
    board = ((np.indices((64, 64)).sum(0)) % 2).astype(np.float32)[..., None] * np.ones(3, np.float32)
    source = quad(np.ones((4, 4), np.float32), 40.0, color=board)
    view = camera((0, -1.2, 0.4), size=(40, 20))
    calm = ibrpipe.render(source, view, "relief")
    noisy = ibrpipe.render(source, view, "relief", anisotropy=0)
    hit = calm.alpha > 0
    assert calm.color[hit].std() < 0.05
    assert noisy.color[hit].std() > 0.15
    np.testing.assert_allclose(calm.color[hit].mean(), 0.5, atol=0.02)


def test_anisotropic_probes_are_nearer_to_the_average_of_many_rays():
    y, x = np.mgrid[:64, :64]
    board = (0.5 + 0.45 * np.sign(np.sin(np.pi * x / 4) * np.sin(np.pi * y / 8)))[..., None] * np.ones(3)
    source = ibrpipe.prepare(quad(np.full((4, 4), 0.9, np.float32), thickness=0.02, color=board), "relief")
    view = camera((0, -2.6, 0.46), size=(40, 30), target=(0, 0, 0), fov=38)
    many = ibrpipe.render(source, view.resized(400, 300), "relief", anisotropy=0)
    inside = many.alpha.reshape(30, 10, 40, 10).mean((1, 3)) == 1
    truth = many.color.reshape(30, 10, 40, 10, 3).mean((1, 3))[inside]
    error = {}
    for probes in (0, 1, 8):
        color = ibrpipe.render(source, view, "relief", anisotropy=probes).color[inside]
        error[probes] = np.sqrt(np.mean((color - truth) ** 2))
    assert error[8] < 0.8 * error[1]
    assert error[8] < 0.8 * error[0]


def test_deformed_vertices_equal_a_new_source():
    mesh, uv = dome()
    source = ReliefMesh(mesh, uv, rough((6, 9)), 0.15)
    moved = mesh.vertices + 0.1 * np.sin(3 * mesh.vertices[:, ::-1])
    view = camera((0.8, -1.9, 1.3), size=(36, 28))
    one = ibrpipe.render(ibrpipe.prepare(source, "relief"), view, "relief", vertices=moved, light=(1, 1, 3))
    other = ibrpipe.render(source.with_vertices(moved), view, "relief", light=(1, 1, 3))
    np.testing.assert_array_equal(one.depth, other.depth)
    np.testing.assert_array_equal(one.color, other.color)
    with pytest.raises(ibrpipe.IbrError, match="vertices must be"):
        ibrpipe.render(source, view, "relief", vertices=moved[:5])
    with pytest.raises(ibrpipe.IbrError, match="deform one relief mesh"):
        ibrpipe.render([source, source], view, "relief", vertices=moved)


def test_given_normals_and_tangents():
    source = quad(rough((6, 6)), 2.0)
    normals = np.tile(np.float32([0, 0, 1]), (2, 3, 1))
    tangents = np.tile(np.float32([1, 0, 0]), (2, 3, 1))
    same = replace(source, normals=normals, tangents=tangents)
    view = camera()
    np.testing.assert_allclose(*(ibrpipe.render(s, view, "relief").depth for s in (source, same)), rtol=1e-6)
    turned = replace(source, tangents=np.tile(np.float32([0, 1, 0]), (2, 3, 1)))
    assert not np.allclose(*(ibrpipe.render(s, view, "relief").depth for s in (source, turned)), rtol=1e-6)


def test_back_sides_are_hidden_or_plain():
    view = camera((0.5, 0.4, -2.0), target=(0, 0, 0))
    source = quad(rough((6, 6)))
    assert not np.isfinite(ibrpipe.render(source, view, "relief").depth).any()
    seen = ibrpipe.render(source, view, "relief", two_sided=True, light=(0, 0, -3))
    flat = ibrpipe.render(source, view, "relief", two_sided=True, mapping="plain").depth
    assert np.isfinite(flat).any()
    np.testing.assert_array_equal(seen.depth, flat)
    assert np.isfinite(seen.color).all()


def test_thread_count_changes_no_byte():
    mesh, uv = dome(9)
    source = ReliefMesh(mesh, uv, rough((16, 12)), 0.15, color=rough((20, 20, 3)))
    for search in ("exact", "linear-binary"):
        one, two = (
            ibrpipe.render(source, camera(size=(70, 50)), "relief", search=search, light=(1, 1, 3), threads=n)
            for n in (1, 0)
        )
        assert one.depth.tobytes() == two.depth.tobytes()
        assert one.color.tobytes() == two.color.tobytes()


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"height": np.full((4, 4), np.nan)}, "height holds nan"),
        ({"height": np.full((4, 4), np.inf)}, "height holds inf"),
        ({"height": np.full((4, 4), -0.1)}, "height holds -0.1"),
        ({"height": np.ones((0, 4))}, "no texels"),
        ({"back": np.ones((3, 3))}, "as large as height"),
        ({"thickness": 0.0}, "thickness is 0.0"),
        ({"edges": "clamp"}, "edges is 'clamp'"),
        ({"uv": QUAD_UV[:1]}, "uv must be"),
        ({"uv": QUAD_UV * np.nan}, "uv holds NaN"),
        ({"color": np.full((2, 2, 3), -1.0)}, "negative light"),
        ({"normal": np.full((2, 2, 3), np.nan)}, "normal holds NaN"),
        ({"tangents": np.ones((1, 3, 3))}, "tangents must be"),
    ],
)
def test_wrong_reliefs_are_refused(change, text):
    parts = {"mesh": QUAD, "uv": QUAD_UV, "height": rough((4, 4)), "thickness": 0.4}
    with pytest.raises(ibrpipe.IbrError, match=text):
        ReliefMesh(**{**parts, **change})


@pytest.mark.parametrize(
    ("option", "text"),
    [
        ({"mapping": "fancy"}, "mapping is 'fancy'"),
        ({"light": (1, 2)}, "light is"),
        ({"ambient": -1}, "ambient is -1"),
        ({"anisotropy": 100}, "anisotropy is 100"),
    ],
)
def test_wrong_options_are_told(option, text):
    with pytest.raises(ibrpipe.IbrError, match=text):
        ibrpipe.render(quad(rough((4, 4))), camera(), "relief", **option)
