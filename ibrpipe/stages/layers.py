"""Layered depth images with diffuse colours, one per support rectangle. Source: gong-yang, sec. 4.1."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ibrpipe.capture.photo_set import load_photos
from ibrpipe.engine.stage import Stage, StageOutputs, artifact
from ibrpipe.io.layers import write_layers
from ibrpipe.io.surfaces.meshes import read_mesh
from ibrpipe.io.views import read_views
from ibrpipe.modelling.diffuse_refinement import sharpen
from ibrpipe.modelling.layers import STATISTICS, LayersConfig, build_layers, rounded
from ibrpipe.modelling.layers_document import Layers, LayersFigures
from ibrpipe.modelling.plan_file import read_plan
from ibrpipe.modelling.sides import caster_of
from ibrpipe.modelling.unseen import close_gaps
from ibrpipe.progress import track


@dataclass(frozen=True)
class Inputs:
    """What the layers stage reads, and the folder that it fills."""

    views: Path
    mesh: Path
    plan: Path
    out: Path
    sides: Path | None = None


@dataclass(frozen=True)
class Outputs(StageOutputs):
    """`layers.json` and one folder per texture with `layers.exr`."""

    layers: Path = artifact("", "Folder of the layers stage.")
    layers_document: Path = artifact("layers.json", "Figures of all textures.", Layers)


def run(inputs: Inputs, config: LayersConfig) -> Outputs:
    """Build every planned texture's layered depth image.

    Raises
    ------
    CaptureError, FormatError
        The views, the mesh or the plan cannot be read.
    """
    plans = read_plan(inputs.plan)
    views = read_views(inputs.views)
    caster = caster_of(read_mesh(inputs.mesh), inputs.sides)
    photos = load_photos(views.train, caster)
    built = [build_layers(which, plans, caster, photos, config) for which in track(range(len(plans)), "layers")]
    plain, rectangles = [not plan.components for plan in plans], [plan.rectangle for plan in plans]
    layered, filled = close_gaps(rectangles, [layers for layers, _ in built], config.fill_gaps)
    statistic = STATISTICS[config.statistic]
    sharp, psnr = sharpen(rectangles, layered, plain, caster, photos, config.sharpen, statistic)
    figures = []
    for which, (layers, (_, figure)) in enumerate(zip(sharp, built, strict=True)):
        folder = inputs.out / f"texture_{which:02d}"
        folder.mkdir(parents=True, exist_ok=True)
        write_layers(rounded(layers, config.color_bits), folder / "layers.exr")
        figure |= {"filled_share": filled[which]}
        figures.append(LayersFigures(**figure, bytes=(folder / "layers.exr").stat().st_size))
    outputs = Outputs.below(inputs.out)
    document = Layers(textures=figures, training_psnr=[round(value, 3) for value in psnr])
    outputs.layers_document.write_text(document.to_json(), encoding="utf-8")
    return outputs


STAGE = Stage(
    name="layers",
    summary="Build layered depth images with the diffuse colour of every surface sample.",
    inputs=Inputs,
    outputs=Outputs,
    config=LayersConfig,
    run=run,
    example="ibrpipe layers --views out/photometry/views.json --mesh out/geometry/mesh.ply --plan out/plan/plan.json "
    "--out out",
)
