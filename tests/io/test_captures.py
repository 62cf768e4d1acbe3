import shutil
from dataclasses import replace

import numpy as np
import pytest

from ibrpipe import read_capture
from ibrpipe.errors import CaptureError, MissingFileError
from ibrpipe.io.captures import CaptureOptions
from ibrpipe.io.photos.images import read_image, write_png
from ibrpipe.io.views import load_depth, load_view


@pytest.fixture
def capture(tiny_ball, tmp_path):
    return shutil.copytree(tiny_ball, tmp_path / "capture")


def test_a_whole_capture(capture):
    found = read_capture(capture)
    assert (len(found.train), len(found.test)) == (14, 3)
    assert [view.name for view in found.train[:2]] == ["000", "001"]
    assert found.mesh == capture / "mesh.ply"
    assert found.exposure == "none"
    assert all(view.held_out and view.depth is not None for view in found.test)
    assert not any(view.held_out for view in found.train)
    assert found.train[3].mask == capture / "masks" / "003.png"


def test_true_depth_fits_mask_and_mesh(capture):
    view = read_capture(capture).test[0]
    _, mask = load_view(view)
    depth = load_depth(view)
    assert depth.shape == mask.shape
    assert np.isfinite(depth[mask == 1]).all()
    distance = np.linalg.norm(view.camera.center)
    assert distance - 1.1 < depth[np.isfinite(depth)].min() < distance - 0.9  # the unit ball's near side


def test_transforms_json_gives_the_same_views(capture):
    with_model = read_capture(capture)
    for folder in (capture, capture / "test"):
        shutil.rmtree(folder / "sparse")
    without = read_capture(capture)
    for one, two in zip(with_model.train + with_model.test, without.train + without.test):
        assert (one.name, one.image, one.mask, one.depth) == (two.name, two.image, two.mask, two.depth)
        assert np.abs(one.camera.cam_from_world - two.camera.cam_from_world).max() < 1e-9
        assert np.abs(one.camera.K - two.camera.K).max() < 1e-9
    assert without.mesh == capture / "mesh.ply"


def test_mesh_named_by_transforms_json(capture):
    (capture / "mesh.ply").rename(capture / "surface.ply")
    text = (capture / "transforms.json").read_text().replace('"mesh.ply"', '"surface.ply"')
    (capture / "transforms.json").write_text(text)
    found = read_capture(capture)
    assert found.mesh == capture / "surface.ply"
    assert any("surface.ply" in note for note in found.notes)


def test_without_test_folder_every_nth_photo_is_held_out(capture):
    shutil.rmtree(capture / "test")
    found = read_capture(capture)
    assert [view.name for view in found.test] == ["000", "008"]
    assert len(found.train) == 12
    assert [view.name for view in read_capture(capture, CaptureOptions(hold_out_every=5)).test] == ["000", "005", "010"]
    assert read_capture(capture, CaptureOptions(hold_out_every=0)).test == ()


def test_exposure_table_is_used_unless_told_otherwise(capture):
    names = [f"{i:03d}.png" for i in range(14)]
    lines = [f"{name},{i / 7}" for i, name in enumerate(names)]
    (capture / "exposure.csv").write_text("file,relative_exposure_stops\n" + "\n".join(lines))
    found = read_capture(capture)
    assert found.exposure == "csv"
    assert found.train[7].gain == pytest.approx(0.5)
    plain = read_capture(capture, CaptureOptions(exposure="none"))
    assert np.allclose(load_view(found.train[7])[0] * 2, load_view(plain.train[7])[0], rtol=1e-6)


def test_exposure_as_asked_must_exist(capture):
    with pytest.raises(MissingFileError, match=r"exposure.csv: does not exist although exposure is 'csv'"):
        read_capture(capture, CaptureOptions(exposure="csv"))
    with pytest.raises(CaptureError, match="not every photo has exposure time"):
        read_capture(capture, CaptureOptions(exposure="exif"))


def turn_photo(path, orientation):
    """Store the photo turned, with the tag that turns it back."""
    import OpenImageIO as oiio

    stored = oiio.ImageBuf(str(path))
    turned = oiio.ImageBufAlgo.rotate90(stored)
    turned.specmod().attribute("Orientation", orientation)
    tif = path.with_suffix(".tif")
    turned.write(str(tif))
    path.unlink()
    return tif


def test_orientation_tag_is_obeyed_where_only_the_turned_picture_fits(capture):
    before = read_image(capture / "images" / "000.png")
    turn_photo(capture / "images" / "000.png", 8)
    for file in (capture / "sparse/0/images.txt", capture / "transforms.json"):
        file.write_text(file.read_text().replace("000.png", "000.tif", 1))
    (capture / "masks" / "000.png").rename(capture / "masks" / "000.tif.png")
    view = read_capture(capture, CaptureOptions(orientation="auto")).train[0]
    assert view.oriented
    assert np.allclose(load_view(replace(view, mask=None))[0], before, atol=1e-6)
    with pytest.raises(CaptureError, match=r"000.tif: is 72 x 96 pixels but its camera states 96 x 72"):
        read_capture(capture, CaptureOptions(orientation="ignore"))


def test_photos_in_sub_folders_get_names_fit_for_files(capture):
    (capture / "images" / "left").mkdir()
    (capture / "images" / "000.png").rename(capture / "images" / "left" / "é 0.png")
    (capture / "masks" / "left").mkdir()
    (capture / "masks" / "000.png").rename(capture / "masks" / "left" / "é 0.png")
    file = capture / "sparse/0/images.txt"
    file.write_text(file.read_text().replace("000.png", "left/é 0.png"), encoding="utf-8")
    view = read_capture(capture).train[-1]
    assert view.name == "left__é 0"
    assert view.mask == capture / "masks" / "left" / "é 0.png"
    assert load_view(view)[0].shape == (72, 96, 3)


def test_photos_that_share_a_stem_keep_their_suffix(capture):
    shutil.copy(capture / "images" / "001.png", capture / "images" / "000.jpg")
    file = capture / "sparse/0/images.txt"
    file.write_text(file.read_text().replace("001.png", "000.jpg"))
    write_png(capture / "masks" / "000.jpg.png", np.ones((72, 96)))
    names = [view.name for view in read_capture(capture).train]
    assert names[:2] == ["000_jpg", "000_png"]
    assert len(set(names)) == len(names)


def test_distorted_lenses_become_pinholes(capture):
    file = capture / "sparse/0/cameras.txt"
    line = file.read_text().splitlines()[-1].split()
    focal = line[4]
    file.write_text(f"1 OPENCV 96 72 {focal} {focal} 48 36 -0.2 0.05 0 0\n")
    everything = read_capture(capture).train[0]
    inside = read_capture(capture, CaptureOptions(keep="inside")).train[0]
    assert everything.distortion is not None
    assert everything.camera.width > inside.camera.width
    assert load_view(everything)[0].shape[:2] == (everything.camera.height, everything.camera.width)


def test_capture_folder_may_have_any_name(capture, tmp_path):
    other = tmp_path / "Aufnahme ä 写真"
    capture.rename(other)
    assert load_view(read_capture(other).train[0])[0].shape == (72, 96, 3)
