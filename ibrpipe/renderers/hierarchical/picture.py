"""Draws a scene once: choose, light, sort, composite. Source: max1999, sec. 2 and 3."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ibrpipe.renderers.hierarchical import drawing
from ibrpipe.renderers.hierarchical.data import HierarchicalData
from ibrpipe.renderers.hierarchical.options import HierarchicalOptions
from ibrpipe.renderers.hierarchical.reprojection import reproject, without_slices
from ibrpipe.renderers.hierarchical.selection import select
from ibrpipe.renderers.hierarchical.shaded import ShadedSlices
from ibrpipe.renderers.hierarchical.view import view_of
from ibrpipe.types import Array, Camera, Frame, Lighting


@dataclass(frozen=True, eq=False)
class Picture:
    """Straight colour (H, W, 3), coverage (H, W), depth (H, W) where it was asked for, and what was drawn."""

    color: Array
    alpha: Array
    depth: Array
    counts: dict[str, int]


@dataclass(frozen=True, eq=False)
class Shading:
    """Under what a picture is drawn: the lights, and the slices that they have lit."""

    lighting: Lighting
    shaded: ShadedSlices


def draw_picture(
    data: HierarchicalData,
    camera: Camera,
    shading: Shading,
    options: HierarchicalOptions,
    noted: bool,
    captured: Frame | None,
) -> Picture:
    """Draw what `camera` sees; with depth where `noted`; `captured`: what other renderers drew of the same view."""
    view = view_of(camera, shading.lighting, options.near or 1e-6 * data.radius)
    guide = {"slices": data.guide, "reproject": data.published, "polygons": data.polygons_only}[options.mode]
    start = np.array([data.shown], np.int32)
    chosen = select(data.nodes, guide, start, view.pose.reshape(1, 12), view.limits(options.pixel_error))
    published = options.mode == "reproject"
    shown = without_slices(chosen) if published else chosen
    slices = drawing.place(data.library, shading.shaded, guide.rows, shown, view)
    faces = drawing.set_up(data.nodes, guide.spheres, chosen, view)
    picture = drawing.draw(slices, faces, shading.shaded.texels, view, published or noted, captured)
    if published:
        reproject(data.library, data.views, guide.rows, chosen, view, picture)
    counts = {"parts": len(chosen.slice_nodes), "slices": len(slices[2]), "triangles": len(faces[1])}
    return Picture(*picture, counts)
