"""The true surface that a capture keeps aside: found, brought into the run's world, and told of."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ibrpipe.core.similarity import move_points, move_poses
from ibrpipe.errors import CaptureError, FormatError
from ibrpipe.evaluation.ground_truth import find_truth, placed_truth
from ibrpipe.io.surfaces.meshes import write_mesh
from ibrpipe.io.views import View, ViewSet
from ibrpipe.stages import evaluate
from ibrpipe.synthetic.layout import write_colmap_text
from ibrpipe.types import Camera, Mesh

TURN = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
#: from the truth's world to the run's
WORLD = (0.5, TURN, np.array([1.0, 2, 3]))
MESH = Mesh(np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]), np.array([[0, 1, 2]], np.int32))


def test_the_truth_is_named_withheld_or_kept_aside(tmp_path: Path) -> None:
    given, aside = tmp_path / "given.ply", tmp_path / "capture/truth/mesh.ply"
    aside.parent.mkdir(parents=True)
    document = tmp_path / "geometry.json"
    assert find_truth(None, given, document) is None
    assert find_truth(None, given, None) is None
    facts = {"schema": 1, "reason": "", "vertices": 3, "faces": 1}
    document.write_text(json.dumps({"decision": "given", **facts}))
    aside.touch()
    assert find_truth(None, given, document, tmp_path / "capture") is None
    document.write_text(json.dumps({"decision": "photos", **facts}))
    assert find_truth(None, given, document, tmp_path / "capture") == given
    assert find_truth(None, None, document, tmp_path / "capture") == aside
    assert find_truth(None, None, document, tmp_path) is None
    assert find_truth(Path("other.ply"), given, document, tmp_path / "capture") == Path("other.ply")


@pytest.fixture
def capture(tmp_path: Path) -> tuple[Path, list[View], list[Camera]]:
    """Folder, views in the run's world, and their cameras in the truth's."""
    places = [(3, 0, 0.5), (0, 3, 0.2), (-3, 0, 0), (0, -3, 0.9), (2, 2, 1)]
    true = [Camera.look_at(place, [0, 0, 0], up=(0, 0, 1), fov_y_deg=40, width=64, height=48) for place in places]
    found = move_poses(WORLD, np.array([camera.cam_from_world for camera in true]))
    images = tmp_path / "images"
    views = [
        View(f"{n:03d}", Camera(camera.K, pose, 64, 48), images / f"{n:03d}.png")
        for n, (camera, pose) in enumerate(zip(true, found, strict=True))
    ]
    (tmp_path / "truth").mkdir()
    write_mesh(MESH, tmp_path / "truth/mesh.ply")
    return tmp_path, views, true


def test_true_cameras_bring_the_surface_into_the_runs_world(capture) -> None:
    folder, views, true = capture
    write_colmap_text(folder / "truth/sparse/0", [view.image.name for view in views], true)
    placed = placed_truth(folder / "truth/mesh.ply", views, folder, None)
    assert placed.mesh is not None
    np.testing.assert_allclose(placed.mesh.vertices, move_points(WORLD, MESH.vertices), atol=1e-6)
    for part in ("truth/mesh.ply of the capture", "by the 5 cameras beside it", "scale 0.5"):
        assert part in placed.told
    shaken = [replace(view, camera=_shifted(view.camera, n)) for n, view in enumerate(views)]
    told = placed_truth(folder / "truth/mesh.ply", shaken, folder, None).told
    rest = float(told.split("leaves ")[1].split(" %")[0])
    assert rest == pytest.approx(0.5, rel=0.15)


def _shifted(camera: Camera, n: int) -> Camera:
    """The camera, 0.5 % of the cameras' extent (4.4) up or down."""
    moved = camera.cam_from_world.copy()
    moved[:, 3] -= camera.R @ np.array([0, 0, 0.022 * (-1) ** n])
    return Camera(camera.K, moved, camera.width, camera.height)


def test_cameras_that_are_the_runs_own_move_nothing(capture) -> None:
    folder, views, true = capture
    write_colmap_text(folder / "truth/sparse/0", [view.image.name for view in views], true)
    same = [replace(view, camera=camera) for view, camera in zip(views, true, strict=True)]
    placed = placed_truth(folder / "truth/mesh.ply", same, folder, None)
    assert placed.mesh is not None
    np.testing.assert_array_equal(placed.mesh.vertices, MESH.vertices)
    assert placed.told.endswith("its 5 cameras are those of the run")


def test_cameras_of_other_photos_are_refused(capture) -> None:
    folder, views, true = capture
    names = [views[n].image.name for n in (2, 4, 1, 0, 3)]
    write_colmap_text(folder / "truth/sparse/0", names, true)
    with pytest.raises(CaptureError, match=r"of their extent .* expected the true cameras of these photos"):
        placed_truth(folder / "truth/mesh.ply", views, folder, None)


def test_without_true_cameras_a_world_of_its_own_is_not_measured(capture) -> None:
    folder, views, _ = capture
    document = folder / "run/calibrate/calibration.json"
    document.parent.mkdir(parents=True)
    placed_by = {"decision": "found", "alignment": {"source": "positions", "how": ""}}
    earlier = {"decision": "found", "world": "own", "alignment": {"how": ""}}
    own = {"decision": "found", "alignment": {"source": "own", "how": ""}}
    for known, facts in ((True, {"decision": "given"}), (True, placed_by), (False, earlier), (False, own)):
        document.write_text(json.dumps({"schema": 1, "reason": "", **facts}))
        placed = placed_truth(folder / "truth/mesh.ply", views, folder, folder / "run/calibrate")
        assert (placed.mesh is not None) == known
    assert "no true cameras lie beside it" in placed.told


def test_a_bad_truth_costs_the_report_only_where_it_was_named(capture) -> None:
    folder, views, _ = capture
    (folder / "geometry").mkdir()
    write_mesh(MESH, folder / "geometry/mesh.ply")
    facts = {"schema": 1, "reason": "", "vertices": 3, "faces": 1}
    (folder / "geometry/geometry.json").write_text(json.dumps({"decision": "photos", **facts}))
    (folder / "truth/mesh.ply").write_text("no mesh")
    made = folder / "geometry"
    given = evaluate.Inputs(folder, folder, made / "mesh.ply", folder, folder, geometry=made / "geometry.json")
    known = ViewSet(tuple(views), info={"capture": str(folder)})
    truth, scores = evaluate._measured(given, evaluate.EvaluateConfig(), MESH, known)
    assert truth is not None
    assert (truth.mesh, scores) == (None, None)
    assert truth.told.startswith(f"The surface was not measured against the true one: {folder / 'truth/mesh.ply'}")
    named = evaluate.EvaluateConfig(truth=str(folder / "truth/mesh.ply"))
    with pytest.raises(FormatError, match=r"truth/mesh\.ply"):
        evaluate._measured(given, named, MESH, known)
