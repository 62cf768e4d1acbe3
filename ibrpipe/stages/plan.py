"""Decide what to model, and write down why. Nothing is modelled that the photos do not ask for."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ibrpipe.capture.photo_set import load_photos
from ibrpipe.embree import MeshCaster
from ibrpipe.engine.stage import Stage, StageOutputs, artifact
from ibrpipe.io.documents.plan import Plan
from ibrpipe.io.surfaces.meshes import read_mesh
from ibrpipe.io.views import read_views
from ibrpipe.modelling.frusta import write_frusta
from ibrpipe.modelling.plan_file import write_plan
from ibrpipe.modelling.planning import COVERAGE, PlanConfig, make_plan
from ibrpipe.modelling.sides import find_sides, write_sides


@dataclass(frozen=True)
class Inputs:
    """What the plan stage reads, and the folder that it fills."""

    views: Path
    mesh: Path
    seed: int
    out: Path


@dataclass(frozen=True)
class Outputs(StageOutputs):
    """`plan.json`: textures, and the reason for every choice.

    `frusta.yaml` where there are perspective images, `sides.npz` where faces have two sides or were turned.
    """

    plan: Path = artifact("plan.json", "plan.json of the plan stage.", Plan)
    frusta: Path | None = artifact("frusta.yaml", "Frusta of the perspective images.", optional=True)
    sides: Path | None = artifact("sides.npz", "Sides of the mesh's faces.", optional=True)


def run(inputs: Inputs, config: PlanConfig) -> Outputs:
    """Measure the photos against the mesh and write the plan."""
    mesh = read_mesh(inputs.mesh)
    photos = load_photos(read_views(inputs.views).train, MeshCaster(mesh))
    sides, told = find_sides(mesh, photos, config.two_sided)
    plans, reasons = make_plan(sides.caster(mesh), photos, config, inputs.seed)
    outputs = Outputs.below(inputs.out)
    write_plan(plans, [told, *reasons], outputs.plan)
    shown = [each for each in reasons if each["what"] == COVERAGE and each["choice"]]
    if outputs.sides is not None and not sides.plain:
        write_sides(sides, outputs.sides)
        shown = [told, *shown]
    if shown:
        lines = "".join(f"{each['what']}: {each['reason']}\n" for each in shown)
        (inputs.out / "summary.txt").write_text(lines, encoding="utf-8")
    frusta = [plan.rectangle.frustum for plan in plans if plan.rectangle.frustum]
    if frusta and outputs.frusta is not None:
        write_frusta(frusta, outputs.frusta)
    return outputs.made()


STAGE = Stage(
    name="plan",
    summary="Decide what to model and why: rectangles, resolution, layers, residuals.",
    inputs=Inputs,
    outputs=Outputs,
    config=PlanConfig,
    run=run,
    example="ibrpipe plan --views out/photometry/views.json --mesh out/geometry/mesh.ply --out out",
)
