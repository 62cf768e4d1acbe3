"""Layered depth images with the diffuse colour of every surface sample."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Literal

import numpy as np
from pydantic import Field

from ibrpipe.capture.photo_set import PhotoSet
from ibrpipe.config import StageConfig
from ibrpipe.embree import MeshCaster
from ibrpipe.modelling.plan_file import TexturePlan
from ibrpipe.modelling.rectangles import Rectangle, distinct
from ibrpipe.modelling.rims import Fronts, has_partner, meet_fronts, with_rims
from ibrpipe.types import Array, LayeredDepthImage

#: normals are rounded to this many steps per unit: a power of two, so that they compress well
NORMAL_STEPS = 32


STATISTICS = {"median": 0, "mean": 1, "mode": 2}


class LayersConfig(StageConfig):
    """Settings of the layers stage."""

    statistic: Literal["median", "mean", "mode"] = Field(
        "median", description="How the photos' colours of a surface point become its diffuse colour"
    )
    bins: int = Field(128, ge=8, le=4096, description="Histogram bins per channel")
    color_bits: Literal[8, 16] = Field(
        8, description="8: colours rounded to 8-bit sRGB codes (smaller file); 16: half floats"
    )
    depth_bits: Literal["auto", 8, 16, 32] = Field(
        "auto",
        description="Depth levels over each texture's depth range; auto: as many as make a step at most a sixteenth of "
        "a texel, 32 keeps float32",
    )
    fill_gaps: float = Field(
        4.0,
        ge=0,
        description="Samples that no photo sees, so many texels or fewer from seen ones, take the colour of these; "
        "0 = none",
    )
    sharpen: int = Field(
        1,
        ge=0,
        le=5,
        description="Rounds in which the training photos' errors are carried back into the diffuse colours of textures "
        "without residuals; 0 = none",
    )


def keep_rule(
    which: int, rectangles: Sequence[Rectangle], limits: Sequence[float], points: Array, normals: Array
) -> Array:
    """Say which points belong into layer `which`: it faces them, and within its limit or better than any other.

    Parameters
    ----------
    limits : largest angle between surface normal and rectangle per texture, degrees
    points, normals : (N, 3) world
    """
    own = rectangles[which].facing(points, normals)
    keep = own >= np.cos(np.radians(limits[which]))
    steep = np.flatnonzero((own > 0) & ~keep)
    if len(steep):
        others = [r.facing(points[steep], normals[steep]) for i, r in enumerate(rectangles) if i != which]
        keep[steep] = own[steep] >= (np.max(others, axis=0) if others else -1.0)
    return keep & (own > 0)


def build_layers(
    which: int, plans: Sequence[TexturePlan], caster: MeshCaster, photos: PhotoSet, config: LayersConfig
) -> tuple[LayeredDepthImage, dict[str, Any]]:
    """Cast one texture's rays, keep the surfaces that belong to it, and colour them from the photos, unrounded.

    Returns
    -------
    layers : LayeredDepthImage
        Samples that no photo sees are kept as geometry with colour 0 and 0 observers.
    figures : dict
        Samples, layers, share seen by photos, depth range.
    """
    plan = plans[which]
    fronts = meet_fronts(plan.rectangle, caster)
    fronts = with_rims(fronts, plan.rectangle, caster) if plan.coverage else fronts
    rectangles, limits = [p.rectangle for p in plans], [p.max_angle_deg for p in plans]
    keep = keep_rule(which, rectangles, limits, fronts.points, fronts.normals)
    fronts = fronts[with_rim(keep, fronts, plan.rectangle)]
    fronts = fronts[distinct(fronts.ray, fronts.depth, plan.rectangle.texel)]
    fronts = fronts[first_of_each(fronts.ray, plan.max_layers)]
    color, _, observers = photos.diffuse(fronts.points, fronts.normals, config.bins, STATISTICS[config.statistic])
    color[observers == 0] = 0.0
    # second sides, and what fills less than half of its texel, are only where photos see them
    there = (observers > 0) | ((fronts.face < caster.fronts) & (fronts.coverage >= 0.5))
    fronts, color, observers = fronts[there], color[there], observers[there]
    ray, depth, normals = fronts.ray, fronts.depth, fronts.normals
    texel = float(np.linalg.norm(plan.rectangle.u)) / plan.rectangle.width
    depth = quantize(depth, enough_bits(depth, texel) if config.depth_bits == "auto" else config.depth_bits)
    normals = round_normals(normals)
    height, width = plan.rectangle.height, plan.rectangle.width
    flat = np.searchsorted(ray, np.arange(height * width + 1)).astype(np.int64)
    offsets = np.concatenate([flat[:-1].reshape(height, width), flat[width::width][:, None]], axis=1)
    coverage = fronts.coverage if plan.coverage else None
    layers = LayeredDepthImage(plan.rectangle.frame, offsets, depth, color, normals, observers, coverage)
    return layers, describe(plan, layers)


def round_normals(normals: Array) -> Array:
    """Unit normals (N, 3) float32 as layers hold them, rounded so that they compress well."""
    return np.round(normals * NORMAL_STEPS) / np.float32(NORMAL_STEPS)


def with_rim(keep: Array, fronts: Fronts, rectangle: Rectangle) -> Array:
    """Add to the kept samples (N,) bool those one texel further on the same surface, so that textures overlap."""
    result, spare = keep.copy(), np.flatnonzero(~keep)
    result[spare] = has_partner(fronts[spare], fronts[keep], rectangle, False).any(axis=1)
    return result


def first_of_each(ray: Array, count: int) -> Array:
    """Indices of the first `count` entries of every run in ascending `ray` (N,)."""
    start = np.searchsorted(ray, ray)
    return np.flatnonzero(np.arange(len(ray)) - start < count)


def enough_bits(depth: Array, texel: float) -> int:
    """Bits (8 to 31) that divide the range of depths (N,) into steps of at most a sixteenth of a texel."""
    steps = 16.0 * float(np.ptp(depth)) / texel if len(depth) else 1.0
    return int(np.clip(np.ceil(np.log2(steps + 1.0)), 8, 31))


def quantize(depth: Array, bits: int) -> Array:
    """Round depths (N,) to at least 2^bits levels over their range; order is kept. gong-yang uses 8 bits.

    The step is a power of two, so that rounded values end in zero bits and compress well.
    """
    if bits == 32 or len(depth) == 0:
        return depth.astype(np.float32)
    reach = float(np.ptp(depth)) or abs(float(depth[0])) or 1.0
    step = 2.0 ** np.floor(np.log2(reach / (2**bits - 1)))
    return (np.round(depth.astype(np.float64) / step) * step).astype(np.float32)


def rounded(layers: LayeredDepthImage, color_bits: int) -> LayeredDepthImage:
    """Round the colours as they are stored: 8-bit sRGB codes, or half floats (by the file) for 16 bits."""
    return replace(layers, color=round_to_display(layers.color)) if color_bits == 8 else layers


def round_to_display(color: Array) -> Array:
    """Round linear colours to the nearest 8-bit sRGB code below 1; brighter ones stay."""
    from ibrpipe.core.color import srgb_decode, srgb_encode

    coded = np.round(srgb_encode(np.minimum(color, 1.0)) * 255.0) / 255.0
    return np.where(color >= 1.0, color, srgb_decode(coded)).astype(np.float32)


def describe(plan: TexturePlan, layers: LayeredDepthImage) -> dict[str, Any]:
    """Figures of one texture for `layers.json`."""
    per_pixel = np.diff(layers.offsets, axis=1)
    seen = layers.observers > 0 if layers.observers is not None else np.ones(len(layers.depth), bool)
    return {
        "name": plan.rectangle.name,
        "width": plan.rectangle.width,
        "height": plan.rectangle.height,
        "samples": len(layers.depth),
        "most_layers": int(per_pixel.max(initial=0)),
        "covered_texels": float((per_pixel > 0).mean()),
        "seen_share": float(seen.mean()) if len(seen) else 0.0,
        "depth_range": [float(layers.depth.min()), float(layers.depth.max())] if len(seen) else None,
    }
