"""Decide what to model, and say why. Nothing is modelled that the photos do not ask for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

import numpy as np
from pydantic import Field, field_validator

from ibrpipe.capture.photo_set import PhotoSet
from ibrpipe.config import StageConfig
from ibrpipe.embree import MeshCaster
from ibrpipe.errors import CaptureError
from ibrpipe.io.components import find_kind
from ibrpipe.io.documents.plan import PlannedComponent
from ibrpipe.modelling.appearance import (
    Appearance,
    SurfaceSample,
    appearance,
    edge_share,
    photo_spacing,
    sample_surface,
    sampling_density,
)
from ibrpipe.modelling.frusta import Frustum, covered_share, cube_frusta, greedy_frusta
from ibrpipe.modelling.ladder import PER_PIXEL, Directions, Prices, climb, untried, without_spirals
from ibrpipe.modelling.plan_file import TexturePlan, Told, reason
from ibrpipe.modelling.rectangles import (
    Rectangle,
    RectangleConfig,
    before_surface,
    bounding_box,
    box_faces,
    distinct,
    sized,
)
from ibrpipe.modelling.rims import BAND, look_closely, meet_fronts
from ibrpipe.modelling.sides import TwoSided
from ibrpipe.modelling.trial import try_out
from ibrpipe.modelling.view_dependence.fitter import Fitter
from ibrpipe.modelling.view_dependence.photos_fitter import bytes_of_photos
from ibrpipe.modelling.view_dependence.spiral_plan import SPIRAL, SpiralPlan
from ibrpipe.types import PhotoBlend

#: share of the photos' pixels at edges from which on rims have coverage (vase, demo and wall: 0.03 to 0.06, photos of
#: 96 x 72 pixels 0.23; the plant 0.36)
EDGES = 0.25
#: what the choice of coverage is called in the plan
COVERAGE = "coverage of rims"
#: spiral densities to choose from; coarser ones lose highlights (1/16 costs 0.7 dB on photos 22 degrees apart)
DENSITIES = (1 / 24, 1 / 32, 1 / 48)


class PlanConfig(StageConfig):
    """Settings of the plan stage."""

    rectangles: tuple[RectangleConfig, ...] = Field(
        (), description="Support rectangles placed by hand; empty = as arrange says"
    )
    frusta: tuple[Frustum, ...] = Field((), description="Perspective images placed by hand: eye, target, up, fov")
    arrange: Literal["box", "cube", "greedy"] = Field(
        "box",
        description="What stands where nothing is placed by hand. box: the faces of the mesh's bounding box; cube: six "
        "perspective images along the axes; greedy: perspective images, each where it adds most surface",
    )
    maps: int = Field(16, ge=1, le=256, description="Perspective images that greedy places at the most")
    texel: float | None = Field(
        None, gt=0, description="Texel size of the layers, scene units; absent = from the photos' sampling density"
    )
    oversampling: float = Field(
        1.05, gt=0, le=4, description="Texels per photo pixel on the surface, where the photos are densest"
    )
    max_angle: float = Field(
        48.0,
        gt=0,
        le=90,
        description="Surfaces tilted further than this (degrees) go to a texture that faces them better",
    )
    two_sided: TwoSided = Field(
        "auto",
        description="auto: pieces of the mesh that photos see from behind, too, get both sides; always: all that are "
        "not closed; never: none",
    )
    coverage: Literal["auto", "always", "never"] = Field(
        "auto",
        description="Whether samples at rims hold which share of their texel they fill; auto: where many pixels of the "
        "photos lie at edges, as with leaves and wires",
    )
    max_layers: int = Field(64, ge=1, le=256, description="Layers per texture at the most")
    residuals: Literal["auto", "always", "never"] = Field(
        "auto", description="auto: only where diffuse colour errs by min_error and they mend it by min_gain"
    )
    min_gain: float = Field(0.5, ge=0, description="Gain in dB on left-out photos that residuals must bring")
    min_error: float = Field(
        4.0, ge=0, description="Error of diffuse colour on left-out photos, in 8-bit codes, below which all is well"
    )
    shift: float = Field(
        1.0,
        ge=0,
        le=1,
        description="Photo pixels by which geometry and cameras may misplace colours; differences that this explains "
        "are not taken for view dependence. 0 = all are",
    )
    min_beyond: float = Field(
        3.0,
        ge=0,
        description="Error of diffuse colour, in 8-bit codes, that such a misplacement must leave unexplained",
    )
    directions: Literal["auto", "spiral", "photos"] = Field(
        "auto",
        description="What holds images per direction: images on spiral directions, or the photos themselves; auto: "
        "whichever is worth its bytes, spirals where residuals is always",
    )
    k: float | None = Field(None, gt=0, le=0.5, description="Spiral density; absent = from the angle between photos")
    residual_scale: float = Field(
        0.75, gt=0, le=4, description="Texels of a residual image per texel of the layers, along each edge"
    )
    components: tuple[PlannedComponent, ...] = Field(
        (), description="Further kinds of view dependence, each with its settings, that every texture gets"
    )
    reflection: Literal["auto", "never"] = Field(
        "auto",
        description="auto: shared reflection and colours fitted to all photos at once are tried on left-out photos, "
        "where residuals is auto and no components are named",
    )
    min_gain_asset: float = Field(0.1, ge=0, description="Gain in dB of the whole asset that each rung must bring")
    min_gain_mb: float = Field(0.03, ge=0, description="Gain in dB of the whole asset that a megabyte must bring")
    samples: int = Field(40_000, ge=1000, description="Surface points that are measured")

    @field_validator("components")
    @classmethod
    def _can_be_fitted(cls, components: tuple[PlannedComponent, ...]) -> tuple[PlannedComponent, ...]:
        """Refuse before anything is computed what the residuals stage could not make."""
        for number, component in enumerate(components):
            if component.kind == SPIRAL or component.kind in (each.kind for each in components[:number]):
                raise ValueError(f"kind {component.kind!r} is planned already; name each once, the spiral by residuals")
            find_kind(component.kind).part("fitting", Fitter)
        return components


def choose_rectangles(
    config: PlanConfig, caster: MeshCaster, texel: float, seed: int = 0
) -> tuple[list[Rectangle], list[Told]]:
    """Place the textures: by the user's hand, on the faces of the bounding box, or as perspective images round it."""
    if config.rectangles or config.frusta:
        by_hand = [sized(rectangle, texel) for rectangle in config.rectangles]
        why = "placed by the pipeline file"
        if config.frusta:
            seen = 100 * covered_share(caster.mesh, config.frusta, seed)
            why += f"; the perspective images see {seen:.1f} % of the surface that can be seen"
        return _with_frusta(by_hand, config.frusta, why, caster, texel)
    if config.arrange == "cube":
        cube = cube_frusta(caster.mesh)
        seen = 100 * covered_share(caster.mesh, cube, seed)
        why = f"perspective images along the axes that see {seen:.1f} % of the surface that can be seen"
        return _with_frusta([], cube, why, caster, texel)
    if config.arrange == "greedy":
        frusta, share = greedy_frusta(caster.mesh, config.maps, seed)
        why = f"perspective images that see {100 * share:.1f} % of the surface that can be seen"
        return _with_frusta([], frusta, why, caster, texel)
    center, axes, half, why = bounding_box(caster.mesh)
    faces = box_faces(center, axes, half, texel)
    return faces, [reason("rectangles", "bounding box", why, size=(2 * half).round(6).tolist())]


def _with_frusta(
    rectangles: list[Rectangle], frusta: Sequence[Frustum], why: str, caster: MeshCaster, texel: float
) -> tuple[list[Rectangle], list[Told]]:
    placed = [*rectangles, *(before_surface(f"map {k:02d}", each, caster, texel) for k, each in enumerate(frusta))]
    sizes = [f"{each.width} x {each.height}" for each in placed]
    return placed, [reason("rectangles", len(placed), why, texels=sizes)]


def drop_unseen(rectangles: Sequence[Rectangle], surface: SurfaceSample) -> tuple[list[Rectangle], list[Told]]:
    """Leave out rectangles whose own surface no photo sees."""
    cosines = np.stack([r.facing(surface.points, surface.normals) for r in rectangles], axis=1)
    owner = np.where(cosines.max(axis=1) > 0, cosines.argmax(axis=1), -1)
    kept, reasons = [], []
    for index, rectangle in enumerate(rectangles):
        own = owner == index
        share = float(own.mean())
        seen = float((surface.observers[own] > 0).mean()) if own.any() else 0.0
        figures = {"share_of_surface": round(share, 4), "seen_by_a_photo": round(seen, 4)}
        if seen * share >= 0.001:
            kept.append(rectangle)
            reasons.append(reason(f"texture {rectangle.name}", "kept", "photos see surface that faces it", **figures))
        else:
            reasons.append(reason(f"texture {rectangle.name}", "dropped", "no photo sees what faces it", **figures))
    return kept, reasons


def count_layers(rectangle: Rectangle, caster: MeshCaster, limit: int, coverage: bool = False) -> tuple[int, Told]:
    """Choose layers so that 99.9 % of front-facing samples are kept; measured on every fourth texel row and column.

    With `coverage` what fills a texel in part counts, too.
    """
    grid = np.arange(rectangle.height * rectangle.width).reshape(rectangle.height, rectangle.width)[::4, ::4].ravel()
    parts = [
        look_closely(grid[start : start + BAND], rectangle, caster)
        if coverage
        else meet_fronts(rectangle, caster, grid[start : start + BAND])
        for start in range(0, len(grid), BAND)
    ]
    texel, depth = (np.concatenate([getattr(part, name) for part in parts]) for name in ("ray", "depth"))
    order = np.lexsort((depth, texel))
    kept = texel[order][distinct(texel[order], depth[order], rectangle.texel)]
    counts = np.bincount(np.searchsorted(grid, kept), minlength=len(grid))
    depths = np.bincount(counts, minlength=2)
    at_least = depths[::-1].cumsum()[::-1]  # texels with at least n front-facing surfaces
    total = max(int(at_least[1:].sum()), 1)
    enough = int(np.searchsorted(at_least[1:].cumsum(), 0.999 * total)) + 1
    choice = min(enough, limit)
    why = f"keeps {100 * at_least[1 : choice + 1].sum() / total:.2f} % of the front-facing samples"
    share = {str(n): round(float(at_least[n] / len(grid)), 4) for n in range(1, len(at_least))}
    return choice, reason(f"layers of {rectangle.name}", choice, why, texels_with_at_least=share)


def choose_residuals(name: str, found: Appearance, config: PlanConfig) -> tuple[bool, Told]:
    """Decide by left-out photos whether view dependence is worth modelling."""
    figures = found.as_json()
    if config.residuals != "auto":
        choice = config.residuals == "always"
        return choice, reason(f"residuals of {name}", choice, "set by the pipeline file", **figures)
    if found.blocks < 20:
        why = "too little of the photos shows it to measure view dependence"
        return False, reason(f"residuals of {name}", False, why, **figures)
    codes, beyond = found.codes, found.beyond_codes
    if codes < config.min_error:
        why = (
            f"diffuse colour predicts left-out photos to {codes:.1f} codes of 255; {config.min_error} would be visible"
        )
        return False, reason(f"residuals of {name}", False, why, **figures)
    if beyond < config.min_beyond:
        why = (
            f"diffuse colour errs by {codes:.1f} codes of 255 on left-out photos, but colours misplaced by up to "
            f"{config.shift} pixels explain all but {beyond:.1f}, less than the {config.min_beyond} asked for: "
            f"geometry that is slightly off, not a surface that changes with the view"
        )
        return False, reason(f"residuals of {name}", False, why, **figures)
    choice = found.gain >= config.min_gain
    verdict = "at least" if choice else "less than"
    why = (
        f"diffuse colour errs by {codes:.1f} codes of 255 on left-out photos, by {beyond:.1f} if colours may be "
        f"misplaced by {config.shift} pixels; view-dependent colour predicts them "
        f"{found.gain:.2f} dB better, {verdict} the {config.min_gain} dB asked for"
    )
    return choice, reason(f"residuals of {name}", choice, why, **figures)


def choose_coverage(config: PlanConfig, photos: PhotoSet) -> tuple[bool, Told]:
    """Decide by the photos' pixels at edges whether samples at rims hold which share of their texel they fill."""
    share = edge_share(photos)
    choice, why = config.coverage == "always", "set by the pipeline file"
    if config.coverage == "auto":
        choice = share >= EDGES
        why = (
            f"{100 * share:.0f} % of the photos' pixels lie at edges of surfaces; from {100 * EDGES:.0f} % on, as with "
            "leaves and wires, samples there hold which share of their texel they fill"
        )
    return choice, reason(COVERAGE, choice, why, edge_pixels=round(share, 4))


def choose_k(config: PlanConfig, photos: PhotoSet, center: np.ndarray) -> tuple[float, Told]:
    """Choose the coarsest density of `DENSITIES` whose pitch is no wider than the angle between photos."""
    spacing = photo_spacing(photos, center)
    if config.k is not None:
        return config.k, reason("k", config.k, "set by the pipeline file", photo_spacing_deg=round(spacing, 2))
    k = next((k for k in DENSITIES if np.degrees(2 * np.pi * k) <= spacing), DENSITIES[-1])
    why = (
        f"turns {np.degrees(2 * np.pi * k):.1f} degrees apart, the photos {spacing:.1f}: turns wider than the photos' "
        f"spacing or than {np.degrees(2 * np.pi * DENSITIES[0]):.0f} degrees lose highlights, narrower ones cost bytes"
    )
    return k, reason("k", round(k, 6), why, photo_spacing_deg=round(spacing, 2))


def choose_texel(config: PlanConfig, surface: SurfaceSample, photos: PhotoSet) -> tuple[float, Told]:
    """Choose the texel from the photos' own sampling density on the surface."""
    density = sampling_density(surface, photos)
    figures = {"photo_pixels_per_unit": {"median": round(density[0], 3), "densest_tenth": round(density[1], 3)}}
    if config.texel is not None:
        return config.texel, reason("texel", config.texel, "set by the pipeline file", **figures)
    texel = 1.0 / (density[1] * config.oversampling)
    why = f"{config.oversampling} texels per photo pixel where the photos sample the surface densest"
    return texel, reason("texel", round(texel, 8), why, **figures)


def make_plan(
    caster: MeshCaster, photos: PhotoSet, config: PlanConfig, seed: int
) -> tuple[list[TexturePlan], list[Told]]:
    """Measure the capture and decide; returns the textures and the reasons.

    Raises
    ------
    CaptureError
        No photo sees any of the surface.
    """
    surface = sample_surface(caster, photos, config.samples, seed)
    if not (surface.observers > 0).any():
        raise CaptureError("no photo sees the mesh; check that cameras and mesh share one coordinate system")
    texel, texel_reason = choose_texel(config, surface, photos)
    rectangles, reasons = choose_rectangles(config, caster, texel, seed)
    reasons.append(texel_reason)
    rectangles, dropped = drop_unseen(rectangles, surface)
    if not rectangles:
        raise CaptureError("no photo sees surface that faces any support rectangle; turn them round or move them")
    k, k_reason = choose_k(config, photos, caster.mesh.vertices.mean(axis=0))
    coverage, coverage_reason = choose_coverage(config, photos)
    reasons += [*dropped, k_reason, coverage_reason]
    found = appearance(rectangles, caster, photos, seed, config.shift)
    plans = []
    for rectangle, measured in zip(rectangles, found, strict=True):
        layers, why_layers = count_layers(rectangle, caster, config.max_layers, coverage)
        residuals, why_residuals = choose_residuals(rectangle.name, measured, config)
        reasons += [why_layers, why_residuals]
        spiral = (SpiralPlan(k=k, residual_scale=config.residual_scale),) if residuals else ()
        plans.append(TexturePlan(rectangle, config.max_angle, layers, (*spiral, *config.components), coverage))
    if PhotoBlend.kind in (each.kind for each in config.components):
        return without_spirals(plans), reasons
    always = config.residuals == "always" and config.directions == "auto"
    directions = Directions("spiral" if always else config.directions, bytes_of_photos(photos, PER_PIXEL))
    if config.reflection == "never" or config.residuals != "auto" or config.components:
        return untried(plans, directions), reasons
    trial = try_out(plans, caster, photos, seed, 2 if any(plan.components for plan in plans) else 0)
    if trial is None or not trial.pixels.any():
        why = "too few photos, or too little that they show in common, to leave some out"
        reasons.append(reason("rungs", "not tried", why, photos=len(photos.cameras)))
        return untried(plans, directions), reasons
    prices = Prices(config.min_gain_asset, config.min_gain_mb)
    spacing = photo_spacing(photos, caster.mesh.vertices.mean(axis=0))
    components, rungs = climb(trial, plans, spacing, prices, directions)
    return [replace(plan, components=each) for plan, each in zip(plans, components, strict=True)], reasons + rungs
