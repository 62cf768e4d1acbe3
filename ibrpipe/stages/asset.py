"""Put the finished parts together as an asset folder, with what is known of its making."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import Field

from ibrpipe.config import StageConfig
from ibrpipe.engine.stage import Stage, StageOutputs, artifact
from ibrpipe.io.assets import INDEX, AssetIndex, TextureEntry, write_index
from ibrpipe.io.components import Component
from ibrpipe.io.documents.plan import Plan
from ibrpipe.io.views import read_views
from ibrpipe.modelling.layers_document import Layers, LayersFigures
from ibrpipe.modelling.plan_file import read_plan
from ibrpipe.modelling.view_dependence.residuals_file import Figures, ResidualsFigures, measured, read_document

LAYERS = "layers.exr"


class AssetConfig(StageConfig):
    """Settings of the asset stage."""

    units: str = Field("scene units of the capture", description="Name of the length unit, such as metre")


@dataclass(frozen=True)
class Inputs:
    """What the asset stage reads, and the folder that it fills."""

    views: Path
    plan: Path
    layers: Path
    residuals: Path
    out: Path


@dataclass(frozen=True)
class Outputs(StageOutputs):
    """`asset.json`; the textures lie beside it."""

    asset: Path = artifact("", "Asset folder.")
    index: Path = artifact(INDEX, "Index of the asset.", AssetIndex)


def run(inputs: Inputs, config: AssetConfig) -> Outputs:
    """Copy layers and residuals into one folder and write its index.

    Raises
    ------
    FormatError, MissingFileError
        A stage's output is missing or damaged.
    """
    plans, views = read_plan(inputs.plan), read_views(inputs.views)
    layers = Layers.read(inputs.layers / "layers.json", "not what the layers stage writes", "layers").textures
    fitted = read_document(inputs.residuals)
    entries = [_entry(inputs, i, layers[i], fitted.of_texture(i)) for i in range(len(plans))]
    _copy(inputs, fitted.shared)
    provenance = {
        "photos": [view.name for view in views.train],
        "held_out": [view.name for view in views.test],
        "reasons": [reason.model_dump(mode="json") for reason in Plan.read(inputs.plan, "not a plan", "plan").reasons],
    }
    index = AssetIndex(units=config.units, textures=entries, shared=fitted.shared, provenance=provenance)
    write_index(index, inputs.out)
    return Outputs.below(inputs.out)


def _entry(inputs: Inputs, index: int, layers: LayersFigures, fitted: Sequence[Figures]) -> TextureEntry:
    """Copy the files of one texture and return its entry."""
    name = f"texture_{index:02d}"
    (inputs.out / name).mkdir(parents=True, exist_ok=True)
    refitted = inputs.residuals / name / LAYERS  # where a component replaces the diffuse colours
    shutil.copyfile(refitted if refitted.is_file() else inputs.layers / name / LAYERS, inputs.out / name / LAYERS)
    components = [figures.component for figures in fitted]
    _copy(inputs, components)
    told: dict[str, Any] = {"layers": layers.model_dump(mode="json"), "residuals": None}
    for figures in fitted:
        spiral = isinstance(figures, ResidualsFigures)
        told["residuals" if spiral else figures.component.kind] = measured(figures)
    return TextureEntry(name=layers.name, layers=f"{name}/{LAYERS}", components=components, measured=told)


def _copy(inputs: Inputs, components: Sequence[Component]) -> None:
    """Copy the files of components from the residuals stage's folder."""
    for path in (path for component in components for path in component.paths):
        (inputs.out / path).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(inputs.residuals / path, inputs.out / path)


STAGE = Stage(
    name="asset",
    folder="assembled",
    summary="Put layers and residuals together as an asset folder, uncompressed.",
    inputs=Inputs,
    outputs=Outputs,
    config=AssetConfig,
    run=run,
    example="ibrpipe asset --views out/ingest/views.json --plan out/plan/plan.json --layers out/layers "
    "--residuals out/residuals --out out",
)
