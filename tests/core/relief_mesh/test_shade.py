"""Colour, light and shadow of hits: the kernel against its twin, on frames and places drawn at random."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
import relief_mesh_twin
import relief_shade_twin as twin
from kernel_runs import on_all_thread_counts
from relief_mesh_scene import rough

from ibrpipe.core.relief_mesh import hit, shade
from ibrpipe.core.relief_mesh.map import build_bounds, pad_layer, plan_levels, shift_of
from ibrpipe.core.relief_mesh.mips import build_mips

SIZE, RELIEF = (6, 9), (5, 7)
WAYS = np.array([[0.11, 0.01, -0.5], [-0.02, 0.13, -0.4], [0.0, 0.01, 1.0]])
MAPPINGS = ("plain", "bump", "parallax", "relief")


def relief(edges="wrap", two=False):
    height = rough(RELIEF)
    return SimpleNamespace(height=height, back=(height * rough(RELIEF, 4)) if two else None, edges=edges)


def layers_of(source):
    wraps = source.edges == "wrap"
    front, back, highs = pad_layer(1 - source.height, wraps), np.empty((0, 0), np.float32), np.empty(0, np.float32)
    plan = plan_levels(front.shape[0] - 1, front.shape[1] - 1, wraps)
    if source.back is not None:
        back = pad_layer(1 - source.back, wraps)
        highs = build_bounds(back, plan, False)
    return front, back, build_bounds(front, plan, True), highs, plan


def hits(source, seed=0):
    """(mine, depth, places, turns, uvz): half of the hits lie on a layer, the others anywhere in the relief."""
    rng, wraps = np.random.default_rng(seed), source.edges == "wrap"
    mine = (rng.random(SIZE) < 0.8).astype(np.uint8)
    depth = rng.uniform(2, 4, SIZE).astype(np.float32)
    uvz = np.concatenate([rng.uniform(-1, 2, (*SIZE, 2)) if wraps else rng.random((*SIZE, 2)),
                          rng.random((*SIZE, 1))], axis=2)  # fmt: skip
    layers, turns = relief_mesh_twin.Layers(source), np.empty((*SIZE, 9), np.float32)
    for y, x in np.ndindex(SIZE):
        grid = layers.front if layers.back is None or x % 2 else layers.back
        if y % 2:
            place = uvz[y, x, :2] * (RELIEF[1], RELIEF[0]) - 0.5
            uvz[y, x, 2] = relief_mesh_twin.bilinear(grid, *place, wraps)
        n = relief_mesh_twin.unit(-(WAYS @ (x + 0.5, y + 0.5, 1.0)) + rng.normal(0, 0.5, 3))
        axes = rng.normal(size=(2, 3))
        axes -= (axes @ n)[:, None] * n
        turns[y, x] = np.linalg.inv(np.stack([*axes, -0.5 * n], axis=1)).ravel()
    scale, shift = (RELIEF[1], RELIEF[0], 1), shift_of(wraps)
    return mine, depth, uvz * scale + (shift, shift, 0), turns, uvz


def rule_of(source, mapping, exact=True, steps=20):
    rule = np.zeros(hit.RULES)
    rule[hit.ACROSS], rule[hit.DOWN] = RELIEF[::-1]
    rule[hit.SHIFT], rule[hit.DEEP] = shift_of(source.edges == "wrap"), 0.5
    rule[hit.MAPPING], rule[hit.EXACT] = MAPPINGS.index(mapping), exact
    rule[hit.STEPS], rule[hit.BISECTION_STEPS], rule[hit.LEAST] = steps, 6, steps
    return rule


def lamp_of(light, probes=0, slopes=True):
    lamp = np.zeros(shade.LAMPS)
    lamp[shade.PROBES], lamp[shade.SLOPES] = probes, slopes
    if light is not None:
        lamp[shade.LIT], lamp[shade.IS_POINT], lamp[shade.TOWARD : shade.TOWARD + 3] = 1, light.is_place, light.way
        for slot, share in ((shade.AMBIENT, light.ambient), (shade.DIFFUSE, light.diffuse),
                            (shade.SPECULAR, light.specular)):  # fmt: skip
            lamp[slot : slot + 3] = share
        lamp[shade.SHININESS], lamp[shade.SHADOWS], lamp[shade.BIAS] = light.shininess, light.shadows, light.bias
    return lamp


def light_of(is_place=False, shadows=True):
    way = np.array([0.4, -0.5, 0.5]) if is_place else np.array([-0.3, -0.6, -1.4])
    return twin.Light(way, is_place, np.array([0.2, 0.25, 0.3]), np.array([0.7, 0.6, 0.5]), np.full(3, 0.3),
                      shadows=shadows)  # fmt: skip


def textures(seed=5):
    """Images (H, W, 4) of colours and of normals or slopes, of sizes that are no powers of two."""
    rng = np.random.default_rng(seed)
    return rng.random((11, 13, 4)), rng.normal((0, 0, 1.5, 0), 0.6, (9, 6, 4))


def levels_of(image):
    texels, table = build_mips(image)
    return [texels[first : first + rows * columns].reshape(rows, columns, 4) for first, rows, columns in table]


def compare(source, mapping="relief", light=None, probes=0, slopes=True, exact=True):
    found, (color, normal) = hits(source), textures()
    mine, depth, places, turns, uvz = found
    rule, lamp = rule_of(source, mapping, exact), lamp_of(light, probes, slopes)

    def shaded():
        out, alpha = np.full((*SIZE, 3), 7, np.float32), np.full(SIZE, 7, np.float32)
        shade.shade_hits(mine, depth, places, turns, layers_of(source), rule, lamp, WAYS, build_mips(color),
                         build_mips(normal), out, alpha)  # fmt: skip
        return out, alpha

    out, alpha = on_all_thread_counts(shaded)
    wanted, wraps = np.full((*SIZE, 3), 7.0), source.edges == "wrap"
    for y, x in np.argwhere(mine > 0):
        frame, pixel = turns[y, x].reshape(3, 3).astype(float), np.array([x + 0.5, y + 0.5])
        foot = twin.footprint(frame, WAYS, pixel, depth[y, x])
        texels = [twin.read(levels_of(each), wraps, *uvz[y, x, :2], foot, probes) for each in (color, normal)]
        wanted[y, x] = texels[0][:3]
        if light is not None:
            way, stepped = WAYS @ (*pixel, 1.0), None if exact else (20, 6)
            surface = texels[0][:3], texels[1], mapping, slopes
            wanted[y, x] = twin.lit(source, light, frame, way, depth[y, x], uvz[y, x], *surface, stepped)
    np.testing.assert_array_equal(alpha, np.where(mine > 0, 1, 7))
    assert 20 < mine.sum() < mine.size
    return out, wanted


def same(out, wanted, share=1.0):
    assert np.isclose(out, wanted, atol=2e-4, rtol=2e-4).all(axis=2).mean() >= share


@pytest.mark.parametrize("edges", ["wrap", "cut"])
@pytest.mark.parametrize("probes", [0, 1, 8])
def test_unlit_colours_are_filtered_over_the_footprint(edges, probes):
    same(*compare(relief(edges), probes=probes))


@pytest.mark.parametrize("mapping", MAPPINGS)
@pytest.mark.parametrize("slopes", [True, False])
@pytest.mark.parametrize("is_place", [True, False])
def test_light_on_every_mapping_equals_the_twin(mapping, slopes, is_place):
    same(*compare(relief(), mapping, light_of(is_place, False), 4, slopes))


@pytest.mark.parametrize("edges", ["wrap", "cut"])
@pytest.mark.parametrize("two", [True, False])
@pytest.mark.parametrize("exact", [True, False])
def test_shadows_equal_the_twin(edges, two, exact):
    dark = compare(relief(edges, two), light=light_of(), exact=exact)
    same(*dark, 0.98)  # a ray that grazes the relief may fall either way
    bright = compare(relief(edges, two), light=light_of(shadows=False), exact=exact)
    same(*bright)
    assert (dark[1] < bright[1] - 1e-3).any()


def test_no_hits():
    source, (color, normal) = relief(), textures()
    _, depth, places, turns, _ = hits(source)
    out, alpha = np.full((*SIZE, 3), 7, np.float32), np.full(SIZE, 7, np.float32)
    shade.shade_hits(np.zeros(SIZE, np.uint8), depth, places, turns, layers_of(source), rule_of(source, "relief"),
                     lamp_of(light_of()), WAYS, build_mips(color), build_mips(normal), out, alpha)  # fmt: skip
    assert (out == 7).all()
    assert (alpha == 7).all()
