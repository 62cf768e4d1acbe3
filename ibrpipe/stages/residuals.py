"""The residuals stage: view-dependent residuals on spiral directions (gong-yang, sec. 4.2), coded and written."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ibrpipe.engine.documents import Residuals as ResidualsDocument
from ibrpipe.engine.stage import Stage, StageOutputs, artifact
from ibrpipe.io.residuals import write_residuals
from ibrpipe.modelling.plan_file import TexturePlan, read_plan
from ibrpipe.modelling.view_dependence.coding import code
from ibrpipe.modelling.view_dependence.sample_sets import Samples, assemble
from ibrpipe.modelling.view_dependence.spiral import ResidualsConfig, refine, sample
from ibrpipe.modelling.view_dependence.work_units import (
    Sources,
    forget,
)

ERRORS = "errors.partial.npy"


@dataclass(frozen=True)
class Inputs:
    """What the residuals stage reads, and the folder that it fills."""

    views: Path
    mesh: Path
    plan: Path
    layers: Path
    out: Path


@dataclass(frozen=True)
class Outputs(StageOutputs):
    """`residuals.json` and one file per texture that has residuals."""

    residuals: Path = artifact("", "Folder of the residuals stage.")
    residuals_document: Path = artifact("residuals.json", "Figures of all textures.", ResidualsDocument)


def write_texture(
    plan: TexturePlan, samples: Samples, out: Path, config: ResidualsConfig
) -> tuple[Path, dict[str, Any]]:
    """Code and write one texture's residuals; return the file and its figures for `residuals.json`."""
    texels, valid, zero, clamped = code(samples, config)
    residuals = assemble(plan, config.closed, texels, valid, zero)
    folder = out / f"texture_{samples.which:02d}"
    folder.mkdir(parents=True, exist_ok=True)
    path = write_residuals(residuals, folder, config.quality)
    figures = {
        "name": plan.rectangle.name,
        "directions": len(residuals.alphas),
        "texels": len(valid),
        "valid_share": float(valid.mean()),
        "clamped_texels": clamped,
        "clamped_share": float(clamped / max(valid.sum(), 1)),
        "zero": zero,
        "encoding": config.encoding,
        "texture": samples.which,
        "bytes": path.stat().st_size,
    }
    return path, figures


def run(inputs: Inputs, config: ResidualsConfig) -> Outputs:
    """Sample residuals for every texture that the plan wants them for, and refine them all together.

    Raises
    ------
    CaptureError, FormatError
        The views, the mesh, the plan or the layers cannot be read.
    """
    sources = Sources(inputs.views, inputs.mesh, inputs.plan, inputs.layers)
    plans = read_plan(inputs.plan)
    wanted = [i for i, plan in enumerate(plans) if plan.residuals]
    try:
        samples = [sample(sources, which, config, inputs.out) for which in wanted]
        psnr = refine(sources, samples, inputs.out / ERRORS, config) if samples else []
    finally:
        forget()
    written = [write_texture(plans[s.which], s, inputs.out, config) for s in samples]
    samples.clear()  # some systems do not remove files that are mapped
    for leftover in inputs.out.glob("*.partial"):
        leftover.unlink()
    outputs = Outputs.below(inputs.out)
    content = {"textures": [figures for _, figures in written], "training_psnr": [round(value, 3) for value in psnr]}
    outputs.residuals_document.write_text(json.dumps(content, indent=1), encoding="utf-8")
    return outputs


STAGE = Stage(
    name="residuals",
    summary="Sample view-dependent residuals along the spiral directions of every texture that needs them.",
    inputs=Inputs,
    outputs=Outputs,
    config=ResidualsConfig,
    run=run,
    example="ibrpipe residuals --views out/ingest/views.json --mesh out/geometry/mesh.ply --plan out/plan/plan.json "
    "--layers out/layers --out out",
)
