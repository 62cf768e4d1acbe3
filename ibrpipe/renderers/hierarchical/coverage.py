"""Slices of a scene, their slabs overlapping where they would leak: told by pictures in test directions."""

from __future__ import annotations

import math
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from time import perf_counter

import numpy as np
from scipy import ndimage

from ibrpipe.renderers.hierarchical import drawing
from ibrpipe.renderers.hierarchical.guide import Guide, build_guide
from ibrpipe.renderers.hierarchical.nodes import Nodes
from ibrpipe.renderers.hierarchical.prefiltering import Slicing, is_composed, prerender_nodes
from ibrpipe.renderers.hierarchical.selection import select
from ibrpipe.renderers.hierarchical.shaded import ShadedSlices
from ibrpipe.renderers.hierarchical.view import View
from ibrpipe.types import Array, Camera
from ibrpipe.types.prerendered import Prerendered, view_axes

#: pixels along a side of a test picture, its focal length, texels across the part, test directions
_SIZE, _FOCAL, _TEXELS, _TESTS = 48, 480.0, 23, 7
#: texels by which a slab goes on into the one behind it where slabs overlap (max1999, sec. 2)
OVERLAP = 2.0
#: what slabs may leak that do not overlap, and what share of it they may leak that do, to be chosen
_LEAK, _SHARE = 0.001, 0.7
#: share of what is covered that must lie inside: leaves would be counted twice
_SOLID = 0.2


def make_slices(nodes: Nodes, slicing: Slicing, pool: Executor | None = None) -> Prerendered:
    """The slices of nodes whose slabs overlap where they would leak; `pool` takes the parts one by one."""
    began = perf_counter()
    choice = choose_coverage(nodes, slicing)
    library = prerender_nodes(nodes, slicing, choice.overlaps, pool=pool)
    leaks = {name: (leak, choice.leaks[name][1]) for name, leak in measure_leaks(nodes, library).items()}
    return replace(library, info={"seconds": perf_counter() - began, "leaks": leaks})


@dataclass(frozen=True)
class CoverageChoice:
    """For each part, how far its slabs overlap, and what slices of few directions leak so, and with the other choice.

    A leak is the mean of what is seen through pixels that polygons, too, cover wholly, all around as well.
    """

    overlaps: dict[str, float]
    leaks: dict[str, tuple[float, float]]


def choose_coverage(nodes: Nodes, slicing: Slicing) -> CoverageChoice:
    """Try both on slices of few directions; slabs overlap where they would leak, and leak less."""
    trial = replace(slicing, directions=min(24, slicing.directions), finest=_TEXELS)
    found = {}
    for overlap in (0.0, OVERLAP):
        library = prerender_nodes(nodes, trial, dict.fromkeys(nodes.names, overlap), composed=False)
        found[overlap] = measure_leaks(nodes, library)
    plain, other = found[0.0], found[OVERLAP]
    rule = {name: plain[name] > _LEAK and other[name] < _SHARE * plain[name] for name in plain}
    leaks = {name: (other[name], plain[name]) if rule[name] else (plain[name], other[name]) for name in plain}
    return CoverageChoice({name: OVERLAP if which else 0.0 for name, which in rule.items()}, leaks)


def measure_leaks(nodes: Nodes, library: Prerendered) -> dict[str, float]:
    """What is seen through each part where its polygons are closed; parts made from their copies are left out."""
    guide = build_guide(nodes, library)
    sliced = replace(guide, costs=np.zeros_like(guide.costs))
    polygons = replace(guide, kinds=guide.kinds * (0, 1))
    shaded = ShadedSlices(library, np.zeros((len(library.names), 2)))
    leaks = {}
    for part, name in enumerate(library.names):
        node, total, count, covered = nodes.names.index(name), 0.0, 0, 0.0
        if is_composed(nodes, node):
            continue
        for axes in view_axes(_TESTS):
            view = _view(library.spheres[part], axes[2])
            one, exact = (_coverage(nodes, each, library, shaded, node, view) for each in (sliced, polygons))
            inside = ndimage.binary_erosion(exact == 1.0, np.ones((3, 3)))
            total += float((1.0 - one[inside]).sum())
            count += int(inside.sum())
            covered += float(exact.sum())
        leaks[name] = total / count if count > _SOLID * covered else 0.0
    return leaks


def _view(sphere: Array, direction: Array) -> View:
    """A camera from which the part is as many pixels wide as it has texels."""
    distance = 2.0 * sphere[3] * _FOCAL / _TEXELS
    camera = Camera.look_at(
        sphere[:3] + distance * direction, sphere[:3], fov_y_deg=math.degrees(2 * math.atan(_SIZE / 2 / _FOCAL)),
        width=_SIZE, height=_SIZE,
    )  # fmt: skip
    pose = np.ascontiguousarray(camera.cam_from_world).ravel().copy()
    return View(pose, np.array(camera.K), 1e-3 * distance, (_SIZE, _SIZE), np.zeros((0, 3)), np.ones((1, 3)))


def _coverage(nodes: Nodes, guide: Guide, library: Prerendered, shaded: ShadedSlices, node: int, view: View) -> Array:
    chosen = select(nodes, guide, np.array([node], np.int32), view.pose.reshape(1, 12), view.limits(1.0))
    slices = drawing.place(library, shaded, guide.rows, chosen, view)
    faces = drawing.set_up(nodes, guide.spheres, chosen, view)
    return drawing.draw(slices, faces, shaded.texels, view, False)[1]
