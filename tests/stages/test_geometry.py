"""Stage geometry: a given mesh is passed through; without one it says what is missing."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from ibrpipe.errors import CaptureError
from ibrpipe.io.meshes import read_mesh
from ibrpipe.stages.documents import Geometry
from ibrpipe.stages.geometry import STAGE, GeometryConfig, Inputs, run
from ibrpipe.stages.wiring import wire
from ibrpipe.stages.workplace import kept_folder


@pytest.fixture
def ingested(measured, tmp_path: Path) -> Path:
    """Run folder of the ball after ingest."""
    shutil.copytree(measured("ball").folder, tmp_path / "ingest")
    return tmp_path


def test_a_given_mesh_is_passed_through(ingested: Path) -> None:
    given = ingested / "ingest/mesh.ply"
    outputs = run(Inputs(ingested / "ingest/views.json", 0, ingested / "out", given), GeometryConfig())
    assert outputs.mesh.read_bytes() == given.read_bytes()
    found = Geometry.model_validate(json.loads(outputs.geometry.read_text(encoding="utf-8")))
    assert found.decision == "given"
    assert found.faces == len(read_mesh(given).faces)


def test_without_a_mesh_the_message_names_the_capture(ingested: Path) -> None:
    with pytest.raises(CaptureError, match="no mesh found"):
        run(Inputs(ingested / "ingest/views.json", 0, ingested / "out"), GeometryConfig())


def test_the_mesh_of_the_capture_is_wired_where_there_is_one(ingested: Path) -> None:
    wired = wire(STAGE, ingested, None, 3)
    assert wired == {"views": ingested / "ingest/views.json", "seed": 3, "given": ingested / "ingest/mesh.ply"}
    (ingested / "ingest/mesh.ply").unlink()
    assert set(wire(STAGE, ingested, None, 3)) == {"views", "seed"}


def test_half_done_work_is_kept_by_its_key(tmp_path: Path) -> None:
    kept = kept_folder(tmp_path / ".geometry.partial", "one")
    (kept / "half").write_text("done")
    assert (kept_folder(tmp_path / "geometry", "one") / "half").read_text() == "done"
    assert not (kept_folder(tmp_path / "geometry", "two") / "half").exists()
