"""Cameras of a run as transforms.json and as a COLMAP model, read by our own readers and by pycolmap."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner

import ibrpipe
from ibrpipe.cli.main import cli
from ibrpipe.io.cameras.lenses import Lens, project
from ibrpipe.io.cameras.transforms import read_nerfstudio
from ibrpipe.io.photos.images import write_png
from ibrpipe.io.points import SparsePoints, write_points
from ibrpipe.io.views import View, ViewSet, write_views
from ibrpipe.native_imports import import_pycolmap

LENSES = [
    None,
    Lens("OPENCV", (60.0, 61.0, 31.0, 23.5, 0.05, -0.01, 0.002, -0.001), 64, 48),
    Lens("SIMPLE_RADIAL", (60.0, 32.0, 24.0, 0.03), 64, 48),
    Lens("OPENCV_FISHEYE", (50.0, 50.0, 32.0, 24.0, 0.01, 0.0, 0.0, 0.0), 64, 48),
]


@pytest.fixture
def run(tmp_path):
    """A run of four photos of four lenses and one that is held out; three points, each a colour of the photos."""
    folder = tmp_path / "capture"
    for name in ("images", "test/images"):
        (folder / name).mkdir(parents=True)
    views = []
    for index, lens in enumerate([*LENSES, None]):
        camera = ibrpipe.Camera.look_at((4 - index, index, 1), (0, 0, 0), (0, 0, 1), 45, 64, 48)
        image = folder / ("images" if index < 4 else "test/images") / f"{index}.png"
        write_png(image, np.full((48, 64, 3), 0.1 + 0.2 * index))
        size = (64, 48) if lens is None else None
        views.append(
            View(str(index), camera.resized(32, 24), image, distortion=lens, full_size=size, held_out=index == 4)
        )
    out = tmp_path / "run" / "ingest"
    out.mkdir(parents=True)
    write_views(ViewSet(tuple(views[:4]), tuple(views[4:])), out / "views.json")
    points = SparsePoints(
        np.array([(0, 0, 0), (0.2, 0, 0.1), (-0.1, 0.3, 0)], float),
        np.array([0.5, 0.6, -1], np.float32),
        np.array([0, 2, 4, 6]),
        np.array([0, 1, 1, 2, 2, 3], np.int32),
    )
    write_points(points, out / "points.npz")
    return tmp_path / "run", views, points


def lens_of(view):
    K = view.full_camera.K
    return view.distortion or Lens("PINHOLE", (K[0, 0], K[1, 1], K[0, 2], K[1, 2]), 64, 48)


def test_transforms_come_back_as_they_were(run, tmp_path):
    folder, views, _ = run
    told = ibrpipe.export(folder, tmp_path / "out" / "transforms.json")
    assert told == "5 photos, 1 of them held out, 3 points in transforms_points.ply"
    found = read_nerfstudio(tmp_path / "out" / "transforms.json")
    assert [shot.image.resolve() for shot in found.shots] == [view.image.resolve() for view in views[:4]]
    assert [shot.image.resolve() for shot in found.held_out] == [views[4].image.resolve()]
    rng = np.random.default_rng(0)
    spots = np.column_stack([rng.uniform(-0.3, 0.3, (20, 2)), np.ones(20)])
    for shot, view in zip((*found.shots, *found.held_out), views):
        np.testing.assert_allclose(shot.cam_from_world, view.camera.cam_from_world, atol=1e-9)
        np.testing.assert_allclose(project(shot.lens, spots), project(lens_of(view), spots), atol=1e-6)
    assert found.mesh.name == "transforms_points.ply"


def test_a_colmap_model_comes_back_as_it_was(run, tmp_path):
    folder, views, points = run
    result = CliRunner().invoke(cli, ["export", str(folder), str(tmp_path / "out" / "colmap")])
    assert result.exit_code == 0, result.output
    assert "5 photos in" in result.stdout
    assert (tmp_path / "out/colmap/test.txt").read_text() == "test/images/4.png\n"
    model = import_pycolmap().Reconstruction(str(tmp_path / "out" / "colmap"))
    images = {image.name: image for image in model.images.values()}
    assert sorted(images) == ["images/0.png", "images/1.png", "images/2.png", "images/3.png", "test/images/4.png"]
    for view in views:
        image = images[view.image.relative_to(tmp_path / "capture").as_posix()]
        np.testing.assert_allclose(image.cam_from_world().matrix(), view.camera.cam_from_world, atol=1e-12)
        camera = model.cameras[image.camera_id]
        assert (camera.model.name, tuple(camera.params)) == (lens_of(view).model, lens_of(view).params)
        for spot in image.get_observation_points2D():
            seen = model.points3D[spot.point3D_id].xyz
            np.testing.assert_allclose(image.project_point(seen), spot.xy, atol=1e-4)
    assert len(model.cameras) == 4
    found = np.array([model.points3D[key].xyz for key in sorted(model.points3D)])
    np.testing.assert_allclose(found, points.xyz)
    colors = [model.points3D[key].color[0] for key in sorted(model.points3D)]
    assert colors == [89, 149, 188]  # sRGB of 0.1, 0.3, 0.5
    assert [model.points3D[key].track.length() for key in sorted(model.points3D)] == [2, 2, 2]


def test_our_own_reader_takes_the_model(run, tmp_path):
    folder, views, points = run
    ibrpipe.export(folder, tmp_path / "capture/sparse/0", form="colmap")
    (tmp_path / "capture/sparse/0/test.txt").unlink()
    shutil.rmtree(tmp_path / "capture/test")
    names = tmp_path / "capture/sparse/0/images.txt"
    kept = [line for line in names.read_text().split("\n") if "test/images" not in line]
    names.write_text("\n".join(kept).replace("images/", ""))
    capture = ibrpipe.read_capture(tmp_path / "capture")
    assert [view.image.name for view in capture.train] == [f"{n}.png" for n in range(4)]
    for found, view in zip(capture.train, views):
        np.testing.assert_allclose(found.camera.cam_from_world, view.camera.cam_from_world, atol=1e-12)
    assert (tmp_path / "capture/sparse/0/points3D.txt").read_text().count("\n") == len(points.xyz) + 1


def test_what_cannot_be_exported_is_told(run, tmp_path):
    folder, views, _ = run
    with pytest.raises(ibrpipe.IbrError, match=r"holds no ingest/views.json; give the folder of a run"):
        ibrpipe.export(tmp_path / "capture", tmp_path / "transforms.json")
    with pytest.raises(ibrpipe.IbrError, match="no COLMAP text model; name another folder"):
        ibrpipe.export(folder, tmp_path / "capture", form="colmap")
    with pytest.raises(ibrpipe.IbrError, match="has no setting 'tolerance'"):
        ibrpipe.export(folder, tmp_path / "colmap", tolerance=1)
    odd = View("odd", views[0].camera, views[0].image, distortion=Lens("FOV", (60.0, 60.0, 32.0, 24.0, 0.1), 64, 48))
    write_views(ViewSet((odd,)), folder / "ingest/views.json")
    (folder / "ingest/points.npz").unlink()
    with pytest.raises(
        ibrpipe.IbrError, match=r"photo odd: transforms.json has no camera model FOV; export it as colmap"
    ):
        ibrpipe.export(folder, tmp_path / "transforms.json")
    assert not (tmp_path / "transforms.json").exists()


def test_files_without_points_are_whole(run, tmp_path):
    folder, _, _ = run
    (folder / "ingest/points.npz").unlink()
    assert ibrpipe.export(folder, tmp_path / "t.json") == "5 photos, 1 of them held out"
    assert "ply_file_path" not in json.loads((tmp_path / "t.json").read_text())
    assert ibrpipe.export(folder, tmp_path / "colmap").endswith("1 of them held out, 0 points")
    assert len(import_pycolmap().Reconstruction(str(tmp_path / "colmap")).images) == 5


@pytest.mark.parametrize("name", ["a photo.png", "a\n2 1 0 0 0 0 0 0 1 b.png"])
def test_names_that_colmap_cuts_are_refused_and_transforms_hold_them(run, tmp_path, name):
    folder, views, _ = run
    image = views[0].image.with_name(name)
    write_views(ViewSet((replace(views[0], image=image),)), folder / "ingest/views.json")
    (folder / "ingest/points.npz").unlink()
    with pytest.raises(ibrpipe.IbrError, match=r"up to the first space; rename the photo and run again"):
        ibrpipe.export(folder, tmp_path / "colmap")
    assert not (tmp_path / "colmap").exists()
    ibrpipe.export(folder, tmp_path / "transforms.json")
    (frame,) = json.loads((tmp_path / "transforms.json").read_text())["frames"]
    assert (tmp_path / frame["file_path"]).resolve() == image.resolve()
