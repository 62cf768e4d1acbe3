"""The fitter of the kind "reflection": diffuse texels and tables of all textures, fitted together and written."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from pydantic import Field, ValidationError

from ibrpipe.errors import FormatError
from ibrpipe.io.assets import write_component
from ibrpipe.io.components import Component, find_kind
from ibrpipe.io.documents.plan import PlannedComponent
from ibrpipe.io.layers import write_layers
from ibrpipe.modelling.diffuse_refinement import sample_points
from ibrpipe.modelling.layers import round_normals, round_to_display
from ibrpipe.modelling.unseen import observers_of
from ibrpipe.modelling.view_dependence.fitter import FitJob, Fitted
from ibrpipe.modelling.view_dependence.reflection.choice import choose_tables
from ibrpipe.modelling.view_dependence.reflection.first_guess import guess, seen_weight
from ibrpipe.modelling.view_dependence.reflection.fit import FitRules, fit
from ibrpipe.modelling.view_dependence.reflection.normals import refine_normals
from ibrpipe.modelling.view_dependence.reflection.observations import Observations, join, observe_pixels, observe_texels
from ibrpipe.modelling.view_dependence.residuals_file import ComponentFigures
from ibrpipe.modelling.view_dependence.work_units import Context, context_of, forget
from ibrpipe.renderers.scene import prepare
from ibrpipe.renderers.view_dependence.mirror import Surface, make_surface
from ibrpipe.renderers.view_dependence.reflection import Model
from ibrpipe.types import Array, LayeredDepthImage, ReflectedLight, Reflection

#: samples of which the pixels say less than this are asked for at their own places in every photo, too
RARELY_SEEN = 3.0
#: the others are asked in every so manieth photo
OWN_EVERY = 4
#: least weight of observations that makes a sample's colour known
KNOWN = 0.01


class ReflectionPlan(PlannedComponent):
    """What a plan may say of a reflection."""

    tables: int | None = Field(None, ge=0, le=2, description="Tables of reflected light; absent = chosen by photos")
    size: int = Field(144, ge=8, le=1024, description="Cells along an edge of a table")


@dataclass(frozen=True, eq=False)
class Found:
    """A fitted model, the (S,) weight of what was observed of every sample, and how the tables were chosen.

    normals : (S, 3) float32 or None
        Where the photos have shown better ones.
    """

    model: Model
    weight: Array
    psnr: tuple[float, ...]
    normals: Array | None = None


class ReflectionFitter:
    """Shared reflection: one diffuse colour a sample, and tables for the whole object."""

    def fit(self, job: FitJob) -> Fitted:
        """Fit all textures together; write the components of the wanted ones, and their new diffuse colours.

        Where no table pays, only diffuse colours are written.

        Raises
        ------
        CaptureError, FormatError
            The views, the mesh, the plan or the layers cannot be read, or a photo holds NaN.
        """
        if not job.wanted:
            return Fitted(())
        plan = _plan(job)
        try:
            context = context_of(job.sources)
            found = fit_textures(context, plan.tables, FitRules(size=plan.size))
        finally:
            forget()
        return _write(job, context.layers, found)


def _plan(job: FitJob) -> ReflectionPlan:
    planned = job.plans[job.wanted[0]].component(job.kind)
    try:
        return ReflectionPlan.model_validate(planned.model_dump() if planned else {"kind": job.kind})
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join(str(part) for part in first["loc"])
        raise FormatError(f"reflection in the plan: {where}: {first['msg']}; run the plan stage again") from error


def fit_textures(context: Context, tables: int | None, rules: FitRules) -> Found:
    """Fit the layers of all textures to all training photos; `tables` None = as many as left-out photos ask for."""
    layers, photos = context.layers, context.photos
    scene = prepare(tuple(layers))
    surface = make_surface(scene, np.concatenate([each.normal for each in layers]))
    surface = replace(surface, corners=np.ascontiguousarray(surface.records[:, 4:]))  # unseen samples may be seen yet
    points = np.concatenate(
        [sample_points(plan.rectangle, each) for plan, each in zip(context.plans, layers, strict=True)]
    )
    seen = observe_pixels(scene, surface, photos, rules.size)
    rare = seen_weight(seen, surface.corners, len(points)) < RARELY_SEEN
    own = observe_texels(surface, points, rare, context.caster, photos, rules.size, OWN_EVERY)
    return fit_observations(seen if own is None else join([seen, own]), surface, points, photos.centers, tables, rules)


def fit_observations(
    seen: Observations, surface: Surface, points: Array, centers: Array, tables: int | None, rules: FitRules
) -> Found:
    """Choose the number of tables where it is not stated, fit to all observations, and turn normals where that pays."""
    psnr: list[float] = []
    if tables is None:
        tables, psnr = choose_tables(seen, surface, points, len(centers), rules)
    model = fit(seen, surface.corners, guess(seen, surface, points), tables, rules)
    weight, refined = seen_weight(seen, surface.corners, len(points)), surface
    if tables:
        refined = refine_normals(model, seen, surface, centers, rules)
    return Found(model, weight, tuple(psnr), None if refined is surface else refined.normals)


def _write(job: FitJob, layers: Sequence[LayeredDepthImage], found: Found) -> Fitted:
    """Write new layers of the wanted textures and, where there are tables, their components."""
    light, model = _light(found.model), found.model
    figures, starts = [], np.cumsum([0] + [len(each.depth) for each in layers])
    for which in job.wanted:
        own, folder = slice(starts[which], starts[which + 1]), job.folder(which)
        color = round_to_display(model.texels[own, :3].astype(np.float64) ** 2)
        observers = np.maximum(observers_of(layers[which]), found.weight[own] > KNOWN).astype(np.int32)
        normal = layers[which].normal if found.normals is None else round_normals(found.normals[own])
        write_layers(replace(layers[which], color=color, normal=normal, observers=observers), folder / "layers.exr")
        if light is None:
            continue
        weights = model.texels[own, 3:] if model.texels.shape[1] > 3 else None
        component = write_component(Reflection(light, weights), folder, _quality(job)).below(folder.name)
        size = sum((job.out / path).stat().st_size for path in component.paths)
        figures.append(
            ComponentFigures(
                name=job.plans[which].rectangle.name, texture=which, bytes=size, component=component,
                tables=len(light.tables), left_out_psnr=[round(value, 3) for value in found.psnr],
            )
        )  # fmt: skip
    shared = None if light is None else _write_shared(job, light)
    return Fitted(tuple(figures), shared)


def _light(model: Model) -> ReflectedLight | None:
    if not len(model.tables):
        return None
    damping, _, *reflectance = (float(value) for value in model.law)
    return ReflectedLight(model.tables.astype(np.float64) ** 2, tuple(reflectance), damping)


def _write_shared(job: FitJob, light: ReflectedLight) -> Component:
    files = find_kind(job.kind).part("files", object)
    return Component(kind=job.kind, **files.write_shared(light, job.out, _quality(job)))


def _quality(job: FitJob) -> int:
    return int(getattr(job.config, "quality", 100))
