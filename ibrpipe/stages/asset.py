"""Put the finished parts together as an asset folder, with what is known of its making."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from pydantic import Field

from ibrpipe.capture.photo_set import load_photos
from ibrpipe.config import StageConfig
from ibrpipe.embree import MeshCaster
from ibrpipe.engine.stage import Stage, StageOutputs, artifact
from ibrpipe.io.assets import INDEX, AssetIndex, TextureEntry, write_index
from ibrpipe.io.components import Component
from ibrpipe.io.documents.plan import Plan
from ibrpipe.io.layers import write_layers
from ibrpipe.io.surfaces.meshes import read_mesh
from ibrpipe.io.views import ViewSet, read_views
from ibrpipe.modelling.background import make_background
from ibrpipe.modelling.layers import rounded
from ibrpipe.modelling.layers_document import Layers, LayersFigures
from ibrpipe.modelling.plan_file import read_plan
from ibrpipe.modelling.view_dependence.residuals_file import Figures, ResidualsFigures, measured, read_document
from ibrpipe.types.bounds import BACKGROUND

LAYERS = "layers.exr"


class AssetConfig(StageConfig):
    """Settings of the asset stage."""

    units: str = Field("scene units of the capture", description="Name of the length unit, such as metre")
    background: Literal["none", "plane"] = Field(
        "none",
        description="plane = what unmasked photos show behind all surface is blended on far planes, a fallback layer",
    )


@dataclass(frozen=True)
class Inputs:
    """What the asset stage reads, and the folder that it fills."""

    views: Path
    plan: Path
    layers: Path
    residuals: Path
    out: Path
    mesh: Path | None = None


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
    if config.background == "plane" and inputs.mesh is not None:
        entries += _background(views, inputs.mesh, len(entries), inputs.out)
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


def _background(views: ViewSet, mesh: Path, count: int, out: Path) -> list[TextureEntry]:
    """Write the far layers behind the `count` textures, say what was made, and return their entries."""
    surface = read_mesh(mesh)
    bare = [view for view in views.train if not view.masked]  # a mask leaves the background out
    made = make_background(load_photos(bare, MeshCaster(surface)), surface) if bare else None
    if made is None:
        told = "no background: the photos show next to nothing behind the surface (masks, or the mesh fills them)"
    else:
        place = f"{made.distance:.4g} scene units from the middle of the photos, "
        if made.spread is None:
            place += "no two of which show the same of it: the distance is a guess"
        else:
            place += f"which differ by {made.spread:.3f} there"
        told = f"background: {len(made.layers)} far plane(s), {place}"
    (out / "summary.txt").write_text(told + "\n", encoding="utf-8")
    entries = []
    for number, layers in enumerate(() if made is None else made.layers):
        name = f"texture_{count + number:02d}"
        (out / name).mkdir()
        write_layers(rounded(layers, 8), out / name / LAYERS)
        height, width = layers.offsets.shape[0], layers.offsets.shape[1] - 1
        figures = {"width": width, "height": height, "samples": len(layers.depth)}
        measured = {"layers": figures | {"most_layers": 1, "seen_share": 1.0}, "residuals": None}
        entries.append(TextureEntry(name=f"{BACKGROUND} {number + 1}", layers=f"{name}/{LAYERS}", measured=measured))
    return entries


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
    example="ibrpipe asset --views out/photometry/views.json --plan out/plan/plan.json --layers out/layers "
    "--residuals out/residuals --out out",
)
