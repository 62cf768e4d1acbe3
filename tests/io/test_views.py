from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ibrpipe.core.color import srgb_decode, srgb_encode
from ibrpipe.errors import CaptureError, FormatError, MissingFileError
from ibrpipe.io.cameras.lenses import Lens, photo_positions, undistorted_calibration
from ibrpipe.io.photos.images import write_exr, write_png
from ibrpipe.io.views import View, ViewSet, load_depth, load_view, read_views, write_views
from ibrpipe.types import Camera

BENT = Lens("OPENCV", (200.0, 200.0, 100.0, 75.0, -0.25, 0.05, 0.002, -0.001), 200, 150)


def smooth(x, y):
    """A scene at infinity: colour by the direction on the plane z = 1, everywhere between 0.1 and 0.9."""
    return np.stack([0.5 + 0.4 * np.sin(6 * x), 0.5 + 0.4 * np.cos(5 * y), 0.5 + 0.4 * np.sin(4 * x * y)], axis=-1)


def bent_photo(path):
    """Photograph `smooth` through the bent lens, exactly: every photo pixel's own ray."""
    from ibrpipe.io.cameras.lenses import _camera

    rows, columns = np.mgrid[0:150, 0:200] + 0.5
    rays = np.asarray(_camera(BENT).cam_from_img(np.stack([columns.ravel(), rows.ravel()], axis=1)))
    colour = smooth(rays[:, 0], rays[:, 1]).reshape(150, 200, 3).astype(np.float32)
    write_exr(path, colour)
    return path


def bent_view(tmp_path, keep="all", **changes):
    K, width, height = undistorted_calibration(BENT, keep)
    camera = Camera(K, np.eye(3, 4), width, height)
    return View("bent", camera, bent_photo(tmp_path / "bent.exr"), distortion=BENT, **changes)


@pytest.fixture
def plain(tmp_path):
    rng = np.random.default_rng(3)
    codes = rng.integers(0, 256, (30, 40, 3))
    write_png(tmp_path / "a.png", srgb_decode(codes / 255.0))
    camera = Camera([[50.0, 0, 20.0], [0, 50.0, 15.0], [0, 0, 1]], np.eye(3, 4), 40, 30)
    return View("a", camera, tmp_path / "a.png"), codes


@pytest.mark.parametrize("keep", ["all", "inside"])
def test_undistorted_photo_is_what_a_pinhole_sees(tmp_path, keep):
    view = bent_view(tmp_path, keep)
    colour, mask = load_view(view)
    camera = view.camera
    rows, columns = np.mgrid[0 : camera.height, 0 : camera.width] + 0.5
    truth = smooth((columns - camera.K[0, 2]) / camera.K[0, 0], (rows - camera.K[1, 2]) / camera.K[1, 1])
    inside = mask > 0.999
    assert colour.shape == (camera.height, camera.width, 3)
    error = np.abs(colour - truth).max(axis=-1)
    x, y = photo_positions(BENT, camera)
    surrounded = inside & (x >= 0) & (x <= 199) & (y >= 0) & (y <= 149)
    # bilinear interpolation errs by h^2 f'' / 8 = 2e-4 here; a shift by half a pixel would give 6e-3
    assert error[surrounded].max() < 2.5e-4
    # in the outermost half pixel the nearest one is taken: at most half a pixel's change of 0.012 x the lens's stretch
    assert error[inside].max() < 8e-3
    assert (inside & ~surrounded).mean() < 0.02
    assert (inside.mean() > 0.999) == (keep == "inside")
    assert (colour[mask == 0] == 0).all()


def test_mask_is_undistorted_with_its_photo(tmp_path):
    view = bent_view(tmp_path)
    half = np.zeros((150, 200, 3), np.float32)
    half[:, :100] = 1
    write_png(tmp_path / "m.png", half)
    _, mask = load_view(replace(view, mask=tmp_path / "m.png"))
    middle = int(view.camera.K[0, 2])
    row = int(view.camera.K[1, 2])
    assert mask[row, middle - 3] == 1
    assert mask[row, middle + 3] == 0


def test_gain_multiplies_linear_light(plain):
    view, codes = plain
    once, _ = load_view(view)
    twice, _ = load_view(replace(view, gain=2.0))
    assert np.allclose(once, srgb_decode(codes / 255.0), rtol=1e-5)
    assert np.array_equal(twice, once * 2)


def test_grey_photos_become_three_channels(tmp_path, plain):
    view, _ = plain
    write_png(tmp_path / "g.png", np.full((30, 40), 0.25))
    colour, _ = load_view(replace(view, image=tmp_path / "g.png"))
    assert colour.shape == (30, 40, 3)
    assert (colour == colour[0, 0, 0]).all()


def test_shrunk_view_keeps_the_mean_light_and_the_rays(plain):
    view, _ = plain
    full, _ = load_view(view)
    small = replace(view, camera=view.camera.resized(20, 15), full_size=(40, 30))
    colour, mask = load_view(small)
    assert colour.shape == (15, 20, 3)
    assert mask.shape == (15, 20)
    assert np.allclose(colour, full.reshape(15, 2, 20, 2, 3).mean(axis=(1, 3)), atol=1e-6)
    corner = small.camera.world_from_pixel @ [20, 15, 1]
    assert np.allclose(corner, view.camera.world_from_pixel @ [40, 30, 1])


def test_alpha_as_mask(tmp_path, plain):
    view, _ = plain
    alpha = np.zeros((30, 40))
    alpha[10:20, 5:9] = 0.6
    write_png(tmp_path / "r.png", np.full((30, 40, 3), 0.5), alpha)
    view = replace(view, image=tmp_path / "r.png", mask_from_alpha=True)
    colour, mask = load_view(view)
    assert mask[12, 6] == pytest.approx(0.6, abs=1e-6)
    assert mask[0, 0] == 0
    assert np.allclose(srgb_encode(colour), srgb_encode(np.float32(0.5)), atol=0.5 / 255)


def test_nonzero_rule_counts_every_label(tmp_path, plain):
    view, _ = plain
    labels = np.zeros((30, 40, 3))
    labels[:, :20] = srgb_decode(3 / 255.0)
    write_png(tmp_path / "m.png", labels)
    _, soft = load_view(replace(view, mask=tmp_path / "m.png"))
    _, hard = load_view(replace(view, mask=tmp_path / "m.png", mask_rule="nonzero"))
    assert soft.max() == pytest.approx(3 / 255.0)
    assert hard.mean() == 0.5


def test_sizes_that_disagree_are_told(tmp_path, plain):
    view, _ = plain
    write_png(tmp_path / "big.png", np.zeros((31, 40, 3)))
    with pytest.raises(CaptureError, match="is 40 x 31 pixels but the camera states 40 x 30"):
        load_view(replace(view, image=tmp_path / "big.png"))
    with pytest.raises(CaptureError, match="is 40 x 31 pixels but the camera states 40 x 30"):
        load_view(replace(view, mask=tmp_path / "big.png"))


def test_photo_with_nan_is_told(tmp_path, plain):
    view, _ = plain
    write_exr(tmp_path / "n.exr", np.full((30, 40, 3), np.nan))
    with pytest.raises(FormatError, match="NaN"):
        load_view(replace(view, image=tmp_path / "n.exr"))


def test_depth_is_shrunk_without_mixing_surfaces(tmp_path, plain):
    view, _ = plain
    depth = np.where(np.arange(40) < 21, 1.0, 9.0) * np.ones((30, 1))
    depth[0] = 0
    np.save(tmp_path / "d.npy", depth)
    small = replace(view, camera=view.camera.resized(20, 15), full_size=(40, 30), depth=tmp_path / "d.npy")
    found = load_depth(small)
    assert found.shape == (15, 20)
    assert set(np.unique(found)) <= {1.0, 9.0, np.inf}
    with pytest.raises(CaptureError, match="has no true depth"):
        load_depth(view)


def test_depth_of_a_bent_lens_follows_the_photo(tmp_path):
    rows, columns = np.mgrid[0:150, 0:200]
    np.save(tmp_path / "d.npy", 1.0 + columns + 1000.0 * rows)
    view = bent_view(tmp_path, depth=tmp_path / "d.npy")
    depth = load_depth(view)
    _, mask = load_view(view)
    assert np.isinf(depth[mask == 0]).all()
    center = depth[int(view.camera.K[1, 2]), int(view.camera.K[0, 2])]
    assert abs((center - 1) % 1000 - 100) <= 1
    assert abs((center - 1) // 1000 - 75) <= 1


def same(one, two):
    assert np.array_equal(one.camera.K, two.camera.K)
    assert np.array_equal(one.camera.cam_from_world, two.camera.cam_from_world)
    names = [name for name in one.__dataclass_fields__ if name != "camera"]
    assert [getattr(one, name) for name in names] == [getattr(two, name) for name in names]


def test_views_file_round_trip(tmp_path, plain):
    root = tmp_path.resolve()
    bent = replace(
        bent_view(root), mask=root / "é" / "m.png", gain=0.1 + 0.2, oriented=True, full_size=(300, 200), held_out=True
    )
    views = ViewSet((replace(plain[0], depth=Path("/else/d.npy")),), (bent,), root / "mesh.ply", {"capture": str(root)})
    write_views(views, root / "views.json")
    back = read_views(root / "views.json")
    same(back.train[0], views.train[0])
    same(back.test[0], views.test[0])
    assert back.mesh == root / "mesh.ply"
    text = (root / "views.json").read_text(encoding="utf-8")
    assert '"image": "a.png"' in text  # relative to the capture
    write_views(back, root / "again.json")
    assert (root / "again.json").read_text(encoding="utf-8") == text


def test_views_file_moves_with_its_mesh(tmp_path, plain):
    (tmp_path / "one").mkdir()
    write_views(ViewSet((plain[0],), (), tmp_path / "one" / "mesh.ply"), tmp_path / "one" / "views.json")
    (tmp_path / "one").rename(tmp_path / "two")
    assert read_views(tmp_path / "two" / "views.json").mesh == tmp_path / "two" / "mesh.ply"


def test_bad_views_files_are_told(tmp_path):
    with pytest.raises(MissingFileError, match="run the ingest stage first"):
        read_views(tmp_path / "views.json")
    for text in ("no", "[]", '{"schema": 1}', '{"schema": 99}'):
        (tmp_path / "views.json").write_text(text)
        with pytest.raises(FormatError, match="run"):
            read_views(tmp_path / "views.json")
