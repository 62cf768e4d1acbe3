"""Put the finished parts together as an asset folder, with what is known of its making."""

from __future__ import annotations

import json
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import Field

from ibrpipe.config import StageConfig
from ibrpipe.engine.stage import Stage, StageOutputs, artifact
from ibrpipe.io.assets import INDEX, AssetIndex, TextureEntry, write_index
from ibrpipe.io.components import Component
from ibrpipe.io.residuals import NAME
from ibrpipe.io.views import read_views
from ibrpipe.modelling.plan_file import read_plan


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
    layers = json.loads((inputs.layers / "layers.json").read_text(encoding="utf-8"))["textures"]
    residuals = json.loads((inputs.residuals / "residuals.json").read_text(encoding="utf-8"))["textures"]
    by_texture = {figure["texture"]: figure for figure in residuals}
    entries = [_entry(inputs, i, layers[i], by_texture.get(i)) for i in range(len(plans))]
    provenance = {
        "photos": [view.name for view in views.train],
        "held_out": [view.name for view in views.test],
        "reasons": json.loads(inputs.plan.read_text(encoding="utf-8"))["reasons"],
    }
    write_index(AssetIndex(units=config.units, textures=entries, provenance=provenance), inputs.out)
    return Outputs.below(inputs.out)


def _entry(inputs: Inputs, index: int, layers: dict[str, Any], residuals: dict[str, Any] | None) -> TextureEntry:
    name = f"texture_{index:02d}"
    folder = inputs.out / name
    folder.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(inputs.layers / name / "layers.exr", folder / "layers.exr")
    components = []
    if residuals is not None:
        shutil.copyfile(inputs.residuals / name / NAME, folder / NAME)
        components.append(Component(kind="spiral", file=f"{name}/{NAME}"))
    measured = {"layers": layers, "residuals": residuals}
    return TextureEntry(name=layers["name"], layers=f"{name}/layers.exr", components=components, measured=measured)


STAGE = Stage(
    name="asset",
    summary="Put layers and residuals together as a finished asset folder.",
    inputs=Inputs,
    outputs=Outputs,
    config=AssetConfig,
    run=run,
    example="ibrpipe asset --views out/ingest/views.json --plan out/plan/plan.json --layers out/layers "
    "--residuals out/residuals --out out",
)
