"""Stage geometry: a given mesh is passed through; without one it says what is missing."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ibrpipe.embree import MeshCaster
from ibrpipe.engine.artifacts import wire
from ibrpipe.engine.run_folder import kept_folder
from ibrpipe.errors import CaptureError
from ibrpipe.evaluation.surface_error import compare_surfaces
from ibrpipe.io.dense import Workspace, read_map, write_map
from ibrpipe.io.documents.geometry import Geometry
from ibrpipe.io.surfaces.meshes import read_mesh, read_vertex_values
from ibrpipe.io.views import read_views, write_views
from ibrpipe.reconstruction.depth.given import given_maps, lacking
from ibrpipe.stages.geometry import STAGE, GeometryConfig, Inputs, run
from ibrpipe.stages.registry import load_stages


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


@pytest.fixture
def with_depth(ingested: Path) -> Path:
    """The same with the true depth of every photo beside it, as an RGB-D camera gives it."""
    place = ingested / "ingest/views.json"
    views, caster = read_views(place), MeshCaster(read_mesh(ingested / "ingest/mesh.ply"))
    train = []
    for view in views.train:
        np.save(ingested / f"{view.name}.npy", caster.cast_camera(view.camera).t)
        train.append(replace(view, depth=ingested / f"{view.name}.npy"))
    write_views(replace(views, train=tuple(train)), place)
    return ingested


def _run(folder: Path, **settings: object) -> tuple[Geometry, Path]:
    config = GeometryConfig(use_given=False, memory_mb=200, **settings)
    outputs = run(Inputs(folder / "ingest/views.json", 0, folder / "out", folder / "ingest/mesh.ply"), config)
    return Geometry.model_validate(json.loads(outputs.geometry.read_text(encoding="utf-8"))), outputs.mesh


def test_depth_of_the_capture_becomes_a_mesh(with_depth: Path) -> None:
    found, path = _run(with_depth)
    assert (found.decision, found.method) == ("depth", "poisson")
    assert found.coverage is not None
    assert found.coverage.median_photos >= 3
    assert len(found.depth_maps or ()) == 14
    truth = read_mesh(with_depth / "ingest/mesh.ply")
    views = read_views(with_depth / "ingest/views.json").train
    assert compare_surfaces(read_mesh(path), truth, views, (0.005,), 3000).scores[0].f_score > 0.97
    values = read_vertex_values(path)
    assert set(values) == {"confidence", "observations"}
    maps = Workspace(with_depth / "out/dense")
    assert read_map(maps.depth(views[0].name)).shape == (72, 96)
    assert maps.fusion_list.read_text().splitlines()[0] == f"{views[0].name}.png"
    assert not list((with_depth / ".out.work").glob("fused*"))


def test_maps_of_a_colmap_workspace_are_read_where_they_are(with_depth: Path) -> None:
    views = read_views(with_depth / "ingest/views.json").train
    capture = with_depth / "capture"
    (capture / "stereo/depth_maps").mkdir(parents=True)
    (capture / "images").mkdir()
    moved = []
    for view in views:
        write_map(capture / f"stereo/depth_maps/{view.image.name}.geometric.bin", np.load(view.depth))
        moved.append(replace(view, image=capture / "images" / view.image.name, depth=None))
    found, source = given_maps(moved, capture, Workspace(with_depth / "none"))
    assert source == "depth maps of the COLMAP dense workspace"
    assert [each.depth.parent for each in found] == [capture / "stereo/depth_maps"] * len(views)
    assert not (with_depth / "none").exists()
    assert given_maps(moved, None, Workspace(with_depth / "none")) == ((), "")


def test_photos_without_given_depth_are_told_of(with_depth: Path) -> None:
    views = read_views(with_depth / "ingest/views.json").train
    np.save(views[2].depth, np.zeros((72, 96), np.float32))
    np.save(views[3].depth, np.full((72, 96), np.nan, np.float32))
    some = tuple(replace(view, depth=None) if n in (4, 7) else view for n, view in enumerate(views))
    maps, _ = given_maps(some, None, Workspace(with_depth / "some"))
    assert len(maps) == 12
    (line,) = lacking(some, maps)
    assert line.startswith(
        "4 of 14 photos have no depth (002, 003, 004 and 1 more): 2 without a map, 2 with an empty one"
    )
    assert lacking(views[4:], given_maps(views[4:], None, Workspace(with_depth / "rest"))[0]) == []
    empty, _ = given_maps(views[2:4], None, Workspace(with_depth / "none"))
    with pytest.raises(CaptureError, match=r"002\.npy: no pixel has depth in this map, nor in the other 1; expected"):
        lacking(views[2:4], empty)


def test_outlines_alone_need_no_depth(ingested: Path) -> None:
    found, path = _run(ingested, surface={"method": "hull"})
    assert (found.decision, found.method, found.depth_from, found.depth_maps) == ("photos", "hull", "", [])
    assert found.closed
    assert found.unseen_share == 1
    assert (read_vertex_values(path)["observations"] == 0).all()


def test_the_mesh_of_the_capture_is_wired_where_there_is_one(ingested: Path) -> None:
    wired = wire(STAGE, load_stages(), ingested, None, 3)
    assert wired == {"views": ingested / "ingest/views.json", "seed": 3, "given": ingested / "ingest/mesh.ply"}
    (ingested / "ingest/mesh.ply").unlink()
    assert set(wire(STAGE, load_stages(), ingested, None, 3)) == {"views", "seed"}


def test_half_done_work_is_kept_by_its_key(tmp_path: Path) -> None:
    kept = kept_folder(tmp_path / ".geometry.partial", "one")
    (kept / "half").write_text("done")
    assert (kept_folder(tmp_path / "geometry", "one") / "half").read_text() == "done"
    assert not (kept_folder(tmp_path / "geometry", "two") / "half").exists()
