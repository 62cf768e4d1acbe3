"""Stage geometry: the mesh that every later stage reads, given or made from the photos."""

from __future__ import annotations

import os
import shutil
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from time import perf_counter
from typing import Any

from pydantic import Field

from ibrpipe.capture.audit import Surface
from ibrpipe.capture.coverage import spread_points
from ibrpipe.config import StageConfig
from ibrpipe.embree import MeshCaster
from ibrpipe.engine.run_folder import kept_folder
from ibrpipe.engine.stage import Stage, StageOutputs, artifact
from ibrpipe.io.dense import DepthMap, Workspace, write_workspace
from ibrpipe.io.documents.audit import AuditedSurface
from ibrpipe.io.documents.geometry import Geometry
from ibrpipe.io.manifest import digest, write_text
from ibrpipe.io.points import read_points
from ibrpipe.io.surfaces.meshes import read_mesh, write_mesh
from ibrpipe.io.views import View, ViewSet, load_view, read_views
from ibrpipe.progress import Part, Step, whole
from ibrpipe.reconstruction.depth import DepthConfig, depth_parts, estimate_depths
from ibrpipe.reconstruction.depth.given import given_maps, lacking
from ibrpipe.reconstruction.depth.schedule import megapixels
from ibrpipe.reconstruction.depth.spacing import spacing_of, warning
from ibrpipe.reconstruction.surface.build import build_surface, surface_parts
from ibrpipe.reconstruction.surface.settings import SurfaceConfig
from ibrpipe.types import Mesh

SCHEMA = 1
COVERAGE = Step("coverage", 0.2)


class GeometryConfig(StageConfig):
    """Settings of the geometry stage."""

    use_given: bool = Field(
        True, description="Use the capture's own mesh; off = make one from the photos, to be measured against it"
    )
    use_given_depth: bool = Field(
        True, description="Use depth maps that the capture holds; off = estimate depth from the photos"
    )
    depth: DepthConfig = Field(default_factory=DepthConfig, description="How depth is found in the photos")
    surface: SurfaceConfig = Field(default_factory=SurfaceConfig, description="How depth becomes a surface")
    keep_maps: bool = Field(
        True, description="Keep depth, normal and confidence maps as a COLMAP dense workspace in geometry/dense"
    )
    memory_mb: int = Field(
        1000, ge=100, le=1_000_000, description="Memory that maps and volume of the surface may take, megabytes"
    )


@dataclass(frozen=True)
class Inputs:
    """Views, seed, the folder to write to; the capture's own mesh and sparse points where there are any."""

    views: Path
    seed: int
    out: Path
    given: Path | None = None
    points: Path | None = None


@dataclass(frozen=True)
class Outputs(StageOutputs):
    """What geometry writes."""

    mesh: Path = artifact("mesh.ply", "Mesh of the object (PLY).")
    geometry: Path = artifact("geometry.json", "geometry.json of the geometry stage.", Geometry)
    dense: Path | None = artifact("dense", "Depth maps as a COLMAP dense workspace.", optional=True)


def run(inputs: Inputs, config: GeometryConfig) -> Outputs:
    """Write ``mesh.ply`` and ``geometry.json``, and the depth maps where some were made.

    Raises
    ------
    MissingFileError, FormatError, CaptureError
        An input is missing or damaged, or the photos show no surface.
    """
    views = read_views(inputs.views)
    inputs.out.mkdir(parents=True, exist_ok=True)
    outputs = Outputs.below(inputs.out)
    if inputs.given is not None and config.use_given:
        mesh = read_mesh(inputs.given)
        write_mesh(mesh, outputs.mesh)
        document: dict[str, Any] = {"decision": "given", "reason": "the capture has a mesh", **_counts(mesh)}
    else:
        with whole(STAGE.name, _parts(views, config)):
            document = _from_photos(views, inputs, config)
    write_text(outputs.geometry, Geometry.model_validate({"schema": SCHEMA, **document}).to_json(2) + "\n")
    if document.get("warnings"):
        told = "".join(f"warning: {line}\n" for line in document["warnings"])
        (inputs.out / "summary.txt").write_text(told, encoding="utf-8")
    return outputs.made()


def _parts(views: ViewSet, config: GeometryConfig) -> list[Part]:
    """Return the loops that may run, with what they cost; those of depth end unheard where depth is given."""
    depth = [] if config.surface.method == "hull" else depth_parts(views.train, config.depth)
    size = megapixels(views.train, config.depth.max_size, 1)
    return [*depth, *surface_parts(size), COVERAGE.part(size)]


def _from_photos(views: ViewSet, inputs: Inputs, config: GeometryConfig) -> dict[str, Any]:
    """Make the mesh from depth maps; they are kept in a folder of their own until it is done."""
    capture = Path(views.info["capture"]) if "capture" in views.info else None
    work = kept_folder(inputs.out, _key(views, inputs, config))
    workspace, began = Workspace(work / "dense"), perf_counter()
    maps, source = given_maps(views.train, capture, workspace) if config.use_given_depth else ((), "")
    decision, warnings = ("depth", lacking(views.train, maps)) if maps else ("photos", [])
    if not maps and config.surface.method != "hull":
        points = None if inputs.points is None else read_points(inputs.points)
        maps = estimate_depths(views.train, workspace.root, config.depth, inputs.seed, points)
        source = config.depth.method
    depth_seconds = perf_counter() - began
    try:
        built = build_surface(views.train, maps, config.surface, work / "fused", config.memory_mb * 1_000_000)
    finally:
        shutil.rmtree(work / "fused", ignore_errors=True)
    values = {"confidence": built.evidence.confidence, "observations": built.evidence.observations}
    write_mesh(built.mesh, inputs.out / "mesh.ply", values)
    if config.keep_maps and maps and workspace.stereo.is_dir():
        if not workspace.fusion_list.is_file():
            write_workspace(workspace, maps)
        _link_tree(workspace.root, inputs.out / "dense")
    facts = dict(built.facts)
    facts["seconds"] = {"depth": round(depth_seconds, 2), **facts["seconds"]}
    return {
        "decision": decision,
        "reason": facts.pop("reason"),
        "depth_from": source,
        "depth_maps": [_map_facts(each) for each in maps],
        **_spacing(maps, len(views.train), float(facts["measured"]["agreed_depth"]), warnings),
        **facts,
        "coverage": _coverage(views.train, built.mesh),
    }


def _key(views: ViewSet, inputs: Inputs, config: GeometryConfig) -> str:
    """Name what the depth maps depend on."""
    photos = [
        (
            view.name,
            str(view.image),
            view.image.stat().st_mtime_ns,
            view.camera.K.tolist(),
            view.camera.cam_from_world.tolist(),
            view.camera.width,
            view.factors.tolist(),
        )
        for view in views.train
    ]
    sparse = None if inputs.points is None else inputs.points.stat().st_size
    return digest([photos, sparse, inputs.seed, config.use_given_depth, config.depth.model_dump(mode="json")])


def _map_facts(each: DepthMap) -> dict[str, Any]:
    angles = [round(angle, 2) for angle in each.angles]
    return {
        "view": each.view.name,
        "neighbours": list(each.neighbours),
        "angles": angles,
        "seconds": round(each.seconds, 3),
    }


def _spacing(maps: Sequence[DepthMap], photos: int, agreed: float, known: Sequence[str] = ()) -> dict[str, Any]:
    """Tell how far apart the photos stand unless depth was given; `warnings` adds to those that are known."""
    found = spacing_of(maps)
    if found is None:
        return {"warnings": list(known)}
    line = warning(found, photos, agreed)
    angles = {name: round(value, 2) for name, value in asdict(found).items()}
    return {"spacing_deg": angles, "warnings": [*known, *([] if line is None else [line])]}


def _counts(mesh: Mesh) -> dict[str, int]:
    return {"vertices": len(mesh.vertices), "faces": len(mesh.faces)}


def _coverage(views: Sequence[View], mesh: Mesh, samples: int = 20_000) -> AuditedSurface:
    """Say how well the photos see the surface, as the audit does of a given mesh."""
    surface = Surface(spread_points(mesh, samples), MeshCaster(mesh))
    for view in COVERAGE.track(views):
        surface.look(view, load_view(view)[1])
    return surface.coverage()


def _link_tree(source: Path, target: Path) -> None:
    """Copy a folder by hard links where the disk can, so that it takes no more space."""

    def place(one: str, other: str) -> None:
        try:
            os.link(one, other)
        except OSError:
            shutil.copy2(one, other)

    shutil.copytree(source, target, copy_function=place, dirs_exist_ok=True)


STAGE = Stage(
    name="geometry",
    summary="Take the mesh that is given, or make one from the photos.",
    inputs=Inputs,
    outputs=Outputs,
    config=GeometryConfig,
    run=run,
    example="ibrpipe geometry --views out/ingest/views.json --given out/ingest/mesh.ply --out out",
)
