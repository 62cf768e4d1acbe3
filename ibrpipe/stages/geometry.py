"""Stage geometry: the mesh that every later stage reads, given or made from the photos."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ibrpipe.config import StageConfig
from ibrpipe.errors import CaptureError
from ibrpipe.io.manifest import write_json
from ibrpipe.io.meshes import read_mesh, write_mesh
from ibrpipe.io.views import read_views
from ibrpipe.stages.stage import Stage
from ibrpipe.types import Mesh

SCHEMA = 1


class GeometryConfig(StageConfig):
    """Settings of the geometry stage."""


@dataclass(frozen=True)
class Inputs:
    """Views, seed, the folder to write to; the capture's own mesh and sparse points where there are any."""

    views: Path
    seed: int
    out: Path
    given: Path | None = None
    points: Path | None = None


@dataclass(frozen=True)
class Outputs:
    """What geometry writes."""

    mesh: Path
    geometry: Path


def run(inputs: Inputs, config: GeometryConfig) -> Outputs:
    """Write ``mesh.ply`` and ``geometry.json``.

    Raises
    ------
    MissingFileError, FormatError, CaptureError
        An input is missing or damaged, or there is no mesh.
    """
    views = read_views(inputs.views)
    if inputs.given is None:
        raise CaptureError(
            f"{views.info.get('capture', inputs.views)}: no mesh found; expected mesh.ply, .obj, .glb or .stl "
            "(geometry from photos is not there yet: give a mesh)"
        )
    mesh = read_mesh(inputs.given)
    inputs.out.mkdir(parents=True, exist_ok=True)
    outputs = Outputs(inputs.out / "mesh.ply", inputs.out / "geometry.json")
    write_mesh(mesh, outputs.mesh)
    write_json(outputs.geometry, _document(mesh, "given", "the capture has a mesh"))
    return outputs


def _document(mesh: Mesh, decision: str, reason: str) -> dict[str, object]:
    counts = {"vertices": len(mesh.vertices), "faces": len(mesh.faces)}
    return {"schema": SCHEMA, "decision": decision, "reason": reason, **counts}


STAGE = Stage(
    name="geometry",
    summary="Take the mesh that is given, or make one from the photos.",
    inputs=Inputs,
    config=GeometryConfig,
    run=run,
    needs=("ingest",),
    example="ibrpipe geometry --views out/ingest/views.json --given out/ingest/mesh.ply --out out",
)
