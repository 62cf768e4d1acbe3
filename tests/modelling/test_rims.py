"""Coverage of rims: areas and places of edges, wires thinner than a texel, and layers that hold it."""

from __future__ import annotations

import numpy as np
import pytest

import ibrpipe
from ibrpipe.embree import MeshCaster
from ibrpipe.modelling.layers import LayersConfig, build_layers
from ibrpipe.modelling.plan_file import TexturePlan
from ibrpipe.modelling.planning import count_layers
from ibrpipe.modelling.rectangles import RectangleConfig, sized
from ibrpipe.modelling.rims import meet_fronts, with_rims
from ibrpipe.types import Mesh

TEXEL = 0.1


def rectangle(side=3.0, texel=TEXEL):
    """Looks down on the square from 0 to `side` in x and y from a height of 2."""
    return sized(RectangleConfig(name="above", origin=(0, side, 2), u=(side, 0, 0), v=(0, -side, 0)), texel)


def quad(corners, height=0.0):
    vertices = np.column_stack([np.array(corners, float), np.full(4, height)])
    return vertices, np.array([[0, 1, 2], [0, 2, 3]])


def mesh_of(*quads):
    vertices, faces = zip(*quads, strict=True)
    return Mesh(np.concatenate(vertices), np.concatenate([face + 4 * n for n, face in enumerate(faces)]))


def rims_of(mesh, face=None):
    face, caster = face or rectangle(), MeshCaster(mesh)
    return face, with_rims(meet_fronts(face, caster), face, caster)


def upright(edge):
    """A sheet that ends at x = `edge`; its other edges are a quarter of a texel from the border of theirs."""
    return mesh_of(quad([(0.525, 0.525), (edge, 0.525), (edge, 2.475), (0.525, 2.475)]))


@pytest.mark.parametrize("edge", np.linspace(1.503, 1.597, 6))
def test_an_edge_keeps_its_place(edge):
    """Coverage tells it to a quarter of a texel in the worst case."""
    face, found = rims_of(upright(edge))
    row = found.ray // face.width == 15
    assert found.coverage[row].sum() * TEXEL == pytest.approx(edge - 0.525, abs=0.25 * TEXEL)
    assert (found.coverage[row] < 1).sum() <= 3
    np.testing.assert_allclose(found.depth, 2.0, atol=1e-6)


def test_coverage_is_right_in_the_mean():
    edges = 1.5 + TEXEL * (np.arange(20) + 0.5) / 20
    areas = np.array([rims_of(upright(edge))[1].coverage.sum() * TEXEL**2 for edge in edges])
    apart = areas - 1.95 * (edges - 0.525)
    assert abs(apart).max() < 0.25 * TEXEL * 2.1
    assert apart.mean() == pytest.approx(0.0, abs=0.02 * TEXEL * 2)


@pytest.mark.parametrize("width", [0.3, 0.6, 1.0, 1.5])
def test_a_thin_strip_is_followed_without_a_break(width):
    """Slanted strips of so many texels: every row of texels holds them, and as much of them as there is."""
    w = width * TEXEL / 2
    corners = [(0.6 - w, 0.2), (0.6 + w, 0.2), (2.4 + w, 2.8), (2.4 - w, 2.8)]
    face, found = rims_of(mesh_of(quad(corners)))
    per_row = np.bincount(found.ray // face.width, found.coverage, face.height)
    inside = slice(3, 27)
    assert (per_row[inside] > 0).all()
    assert per_row[inside].mean() == pytest.approx(width, rel=0.12)


@pytest.mark.parametrize("center", [(1.487, 1.511), (1.523, 1.478)])
def test_coverage_at_a_silhouette_is_the_sum_of_the_places_that_are_covered(center):
    """Middles stand for 4, middles of edges for 2, corners for 1 sixteenths; see docs/stages/layers.md."""
    angle = np.arange(64) * 2 * np.pi / 64
    circle = np.column_stack([center[0] + np.cos(angle), center[1] + np.sin(angle), np.zeros(64)])
    fan = Mesh(np.vstack([circle, [(*center, 0.0)]]), np.array([[n, (n + 1) % 64, 64] for n in range(64)]))
    face, found = rims_of(fan)
    column, row = found.ray % face.width, found.ray // face.width
    wanted = np.zeros((face.height, face.width))
    apothem = np.cos(np.pi / 64)
    for y, x in np.ndindex(wanted.shape):
        for dy, dx, share in [(j, i, (2 - abs(j)) * (2 - abs(i)) / 16) for j in (-1, 0, 1) for i in (-1, 0, 1)]:
            at = np.array([(x + 0.5 + 0.5 * dx) * TEXEL, 3 - (y + 0.5 + 0.5 * dy) * TEXEL]) - center
            turn = (np.arctan2(at[1], at[0]) % (2 * np.pi / 64)) - np.pi / 64
            wanted[y, x] += share * (np.hypot(*at) * np.cos(turn) < apothem)
    got = np.zeros_like(wanted)
    np.add.at(got, (row, column), found.coverage)
    assert ((got > 0) & (got < 1)).sum() > 40
    np.testing.assert_allclose(got, wanted, atol=1e-6)
    assert found.coverage.sum() * TEXEL**2 == pytest.approx(32 * np.sin(np.pi / 32), rel=0.01)


def test_layers_of_wires_are_counted_with_what_fills_texels_in_part():
    """Two grids of wires a third of a texel wide above each other: the middles of texels meet the lower one only."""
    wires = [
        quad([(x, 0.2), (x + TEXEL / 3, 0.2), (x + TEXEL / 3, 2.8), (x, 2.8)], height)
        for height, start in ((0.0, 0.235), (0.5, 0.285))
        for x in start + TEXEL * np.arange(25)
    ]
    caster = MeshCaster(mesh_of(*wires))
    assert count_layers(rectangle(), caster, 64, coverage=True)[0] == 2
    assert count_layers(rectangle(), caster, 64)[0] == 1
    assert count_layers(rectangle(), caster, 1, coverage=True)[0] == 1


def test_two_sheets_in_one_texel_stay_two():
    lower, upper = quad([(0.5, 0.5), (2.5, 0.5), (2.5, 2.5), (0.5, 2.5)]), quad(
        [(0.5, 0.5), (1.53, 0.5), (1.53, 2.5), (0.5, 2.5)], 0.5)  # fmt: skip
    face, found = rims_of(mesh_of(lower, upper))
    texel = 15 * face.width + 15
    at = found.ray == texel
    np.testing.assert_allclose(found.depth[at], [1.5, 2.0], atol=1e-6)
    np.testing.assert_allclose(found.coverage[at], [0.25, 1.0])
    assert (np.diff(found.ray) >= 0).all()


def test_tilted_rims_lie_in_their_plane():
    vertices, faces = quad([(0.5, 0.5), (2.5, 0.5), (2.5, 2.5), (0.5, 2.5)])
    vertices[:, 2] = 0.6 * vertices[:, 0]
    face, found = rims_of(Mesh(vertices, faces))
    x = (found.ray % face.width + 0.5) * TEXEL
    np.testing.assert_allclose(2.0 - found.depth, 0.6 * x, atol=1e-5)


def test_layers_hold_coverage_where_it_is_planned(measured):
    plant = measured("foliage")
    low, high = plant.caster.mesh.vertices.min(axis=0), plant.caster.mesh.vertices.max(axis=0)
    place = RectangleConfig(
        name="front", origin=(low[0], low[1] - 0.1, high[2]), u=(high[0] - low[0], 0, 0), v=(0, 0, low[2] - high[2])
    )
    face = sized(place, 0.03)
    plain, soft = (
        build_layers(0, [TexturePlan(face, 80.0, 16, (), coverage)], plant.caster, plant.photos, LayersConfig())[0]
        for coverage in (False, True)
    )
    assert plain.coverage is None
    assert len(soft.depth) > len(plain.depth)
    assert soft.coverage.min() > 0
    assert 0.1 < (soft.coverage < 1).mean() < 0.9
    unseen = soft.observers == 0
    assert (soft.coverage[unseen] >= 0.5).all()
    frame = ibrpipe.render(soft, ibrpipe.Camera.look_at((0, -6, 1), (0, 0, 1), width=80, height=80))
    assert ((frame.alpha > 0.1) & (frame.alpha < 0.9)).sum() > 50


@pytest.mark.parametrize("winding", ["consistent", "mixed"])
def test_a_plant_is_shown_better_than_by_the_lumigraph(measured, winding):
    """Held-out views of 96 x 72 pixels, in which wires are thinner than a pixel; figures do not hang on the winding."""
    from ibrpipe.core.psnr import psnr
    from ibrpipe.evaluation.baselines import render_ulr
    from ibrpipe.evaluation.image_scores import to_srgb8
    from ibrpipe.io.views import load_view, read_views
    from ibrpipe.modelling.planning import PlanConfig, make_plan
    from ibrpipe.modelling.sides import find_sides
    from ibrpipe.synthetic.surfaces import wound

    plant = measured("foliage")
    mesh = wound(plant.caster.mesh, winding, np.random.default_rng(8))
    caster = find_sides(mesh, plant.photos)[0].caster(mesh)
    plans, _ = make_plan(caster, plant.photos, PlanConfig(residuals="never", samples=4000), 0)
    assert all(plan.coverage for plan in plans)
    layers = [build_layers(k, plans, caster, plant.photos, LayersConfig())[0] for k in range(len(plans))]
    prepared, figures = ibrpipe.prepare(layers), []
    for view in read_views(plant.folder / "views.json").test:
        photo, mask = load_view(view)
        codes, inside = to_srgb8(photo), mask >= 0.5
        asset, peer = ibrpipe.render(prepared, view.camera), render_ulr(view.camera, caster, plant.photos)
        scores = [psnr(codes, to_srgb8(frame.color), inside) for frame in (asset, peer)]
        figures.append([*scores, (asset.alpha[inside] > 0).mean()])
    shown, blended, covered = np.mean(figures, axis=0)
    assert shown > blended + 2.0
    assert covered > 0.97
    assert 18.0 < shown < 20.5
