"""Real captures, outside the project: set IBRPIPE_DATA to the folder that holds them."""

import os
from pathlib import Path

import numpy as np
import pytest

from ibrpipe.core.color import luminance
from ibrpipe.io.cameras.colmap import find_model, read_model
from ibrpipe.io.cameras.transforms import read_transforms
from ibrpipe.io.captures import CaptureOptions, read_capture
from ibrpipe.io.views import load_depth, load_view
from ibrpipe.native_imports import import_pycolmap
from ibrpipe.stages.ingest import IngestConfig, Inputs, run

pytestmark = pytest.mark.real


def real(name):
    root = os.environ.get("IBRPIPE_DATA")
    if not root:
        pytest.skip("IBRPIPE_DATA is not set; it names the folder of real captures")
    path = Path(root) / name
    if not path.is_dir():
        pytest.skip(f"{path} does not exist")
    return path


@pytest.mark.parametrize("name", ["captures/shiny_vase", "captures/lambert_relief"])
@pytest.mark.parametrize("part", ["", "test"])
def test_colmap_model_and_transforms_agree(name, part):
    root = real(name) / part
    one = read_model(find_model(root), root / "images")
    two, _ = read_transforms(root / "transforms.json")
    assert [shot.image for shot in one] == [shot.image for shot in two]
    assert [shot.lens.model for shot in one] == [shot.lens.model for shot in two]
    assert max(np.abs(np.subtract(a.lens.params, b.lens.params)).max() for a, b in zip(one, two)) < 1e-9
    assert max(np.abs(a.cam_from_world - b.cam_from_world).max() for a, b in zip(one, two)) < 1e-9


@pytest.mark.parametrize(
    ("name", "train", "test"),
    [
        ("captures/shiny_vase", 64, 8),
        ("captures/lambert_relief", 24, 6),
        ("mold-gold-cape", 104, 15),
        ("fountain-P11", 9, 2),
        ("middlebury-dino", 42, 6),
        ("stereo-motorcycle", 2, 0),
    ],
)
def test_every_capture_is_read(name, train, test):
    capture = read_capture(real(name))
    assert (len(capture.train), len(capture.test)) == (train, test)
    view = capture.train[-1]
    colour, mask = load_view(view)
    assert colour.shape == (view.camera.height, view.camera.width, 3)
    assert colour.dtype == mask.dtype == np.float32
    assert mask.max() == 1


@pytest.mark.parametrize("name", ["mold-gold-cape", "fountain-P11", "middlebury-dino"])
def test_poses_put_triangulated_points_where_they_were_measured(name):
    root = real(name)
    model = import_pycolmap().Reconstruction(str(find_model(root)))
    images = {image.name: image for image in model.images.values()}
    capture = read_capture(root)
    errors = []
    for view in capture.train[::5]:
        seen = [point for point in images[view.image.name].points2D if point.has_point3D()]
        world = np.array([model.points3D[point.point3D_id].xyz for point in seen])
        local = world @ view.camera.R.T + view.camera.t
        pixel = (local @ view.camera.K.T)[:, :2] / local[:, 2:]
        errors.append(np.linalg.norm(pixel - np.array([point.xy for point in seen]), axis=1))
    # the data's own READMEs state medians of 0.24, 0.32 and 0.55 px
    assert np.median(np.concatenate(errors)) < 0.6


def test_true_depth_is_where_the_mesh_is():
    from ibrpipe.embree import MeshCaster
    from ibrpipe.io.surfaces.meshes import read_mesh

    capture = read_capture(real("captures/shiny_vase"))
    view = capture.test[0]
    depth, mesh = load_depth(view), MeshCaster(read_mesh(capture.mesh)).cast_camera(view.camera).t
    both = np.isfinite(depth) & np.isfinite(mesh)
    assert (np.isfinite(depth) == np.isfinite(mesh)).mean() > 0.995
    assert np.median(np.abs(depth[both] - mesh[both])) < 1e-5


def test_exposure_table_makes_photos_agree():
    """Points in differently exposed photos: their brightness is nearer with the gains, farther with their inverse."""
    root = real("mold-gold-cape")
    model = import_pycolmap().Reconstruction(str(find_model(root)))
    images = {image.name: image for image in model.images.values()}
    views = read_capture(root, CaptureOptions(hold_out_every=0)).train[::2]
    seen = {}
    for view in views:
        light = luminance(load_view(view)[0] / np.float32(view.gain))
        for point in images[view.image.name].points2D:
            if point.has_point3D():
                column, row = np.clip(point.xy.astype(int), 1, 910)
                value = np.log2(light[row - 1 : row + 2, column - 1 : column + 2].mean() + 1e-4)
                seen.setdefault(point.point3D_id, []).append((value, np.log2(view.gain)))
    tracks = [np.array(track) for track in seen.values() if len(track) >= 5]
    tracks = [track for track in tracks if np.ptp(track[:, 1]) > 0.3]
    spread = {sign: np.median([np.std(track[:, 0] + sign * track[:, 1]) for track in tracks]) for sign in (-1, 0, 1)}
    assert len(tracks) > 300
    assert spread[1] < spread[0] - 0.01 < spread[-1] - 0.05


def test_ingest_of_a_real_capture(tmp_path):
    outputs = run(Inputs(real("captures/shiny_vase"), tmp_path), IngestConfig())
    text = outputs.audit_text.read_text(encoding="utf-8")
    assert "64 photos, 8 held out" in text
    assert "0 errors, 1 warnings" in text  # the vase's inside and foot


def test_a_capture_without_mesh_is_audited(tmp_path):
    outputs = run(Inputs(real("fountain-P11"), tmp_path), IngestConfig())
    assert outputs.given is None
    assert "0 errors" in outputs.audit_text.read_text(encoding="utf-8")
