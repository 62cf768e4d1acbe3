"""The residuals stage: the view dependence that the plan wants, each kind by its fitter."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ibrpipe.engine.stage import Stage, StageOutputs, artifact
from ibrpipe.modelling.plan_file import read_plan
from ibrpipe.modelling.view_dependence.fitter import FitJob, fit_components
from ibrpipe.modelling.view_dependence.residuals_file import NAME, Residuals
from ibrpipe.modelling.view_dependence.spiral import ResidualsConfig
from ibrpipe.modelling.view_dependence.work_units import Sources


@dataclass(frozen=True)
class Inputs:
    """What the residuals stage reads, and the folder that it fills."""

    views: Path
    mesh: Path
    plan: Path
    layers: Path
    out: Path
    sides: Path | None = None


@dataclass(frozen=True)
class Outputs(StageOutputs):
    """`residuals.json` and the files of all components."""

    residuals: Path = artifact("", "Folder of the residuals stage.")
    residuals_document: Path = artifact(NAME, "Figures of all textures.", Residuals)


def run(inputs: Inputs, config: ResidualsConfig) -> Outputs:
    """Fit all view dependence that the plan wants, kind by kind in the order in which it names them.

    Raises
    ------
    CaptureError, FormatError
        The views, the mesh, the plan or the layers cannot be read.
    ConfigError
        The plan wants a kind that is not known or that the pipeline cannot make.
    """
    sources = Sources(inputs.views, inputs.mesh, inputs.plan, inputs.layers, inputs.sides)
    plans = read_plan(inputs.plan)
    kinds = dict.fromkeys(component.kind for plan in plans for component in plan.components)
    fitted = [fit_components(FitJob(kind, sources, plans, config, inputs.out)) for kind in kinds]
    document = Residuals(
        textures=[figures for each in fitted for figures in each.figures],
        training_psnr=[value for each in fitted for value in each.training_psnr],
        shared=[each.shared for each in fitted if each.shared is not None],
    )
    outputs = Outputs.below(inputs.out)
    outputs.residuals_document.write_text(document.to_json(), encoding="utf-8")
    return outputs


STAGE = Stage(
    name="residuals",
    summary="Sample view-dependent residuals along the spiral directions of every texture that needs them.",
    inputs=Inputs,
    outputs=Outputs,
    config=ResidualsConfig,
    run=run,
    example="ibrpipe residuals --views out/photometry/views.json --mesh out/geometry/mesh.ply "
    "--plan out/plan/plan.json --layers out/layers --out out",
)
