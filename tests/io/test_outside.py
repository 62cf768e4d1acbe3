"""A capture reads nothing outside its folder unless it is told that it may; an asset never does."""

import json
import shutil

import pytest

from ibrpipe.errors import CaptureError, FormatError, MissingFileError
from ibrpipe.io.assets import read_index
from ibrpipe.io.captures import CaptureOptions, read_capture
from ibrpipe.io.documents.views import Views
from ibrpipe.stages.ingest import IngestConfig, Inputs, run

ALLOWED = CaptureOptions(allow_outside=True)


@pytest.fixture
def capture(tiny_ball, tmp_path):
    """A capture and, beside it, a photo of its own."""
    shutil.copytree(tiny_ball, tmp_path / "capture")
    (tmp_path / "outside").mkdir()
    shutil.copy(tmp_path / "capture/images/003.png", tmp_path / "outside/003.png")
    return tmp_path / "capture"


def by_link(capture):
    (capture / "images/003.png").unlink()
    (capture / "images/003.png").symlink_to(capture.parent / "outside/003.png")


def by_linked_folder(capture):
    shutil.move(capture / "images", capture.parent / "moved")
    (capture / "images").symlink_to(capture.parent / "moved")


def by_colmap(capture):
    file = capture / "sparse/0/images.txt"
    file.write_text(file.read_text().replace(" 003.png", " ../../outside/003.png"))
    (capture / "images/003.png").unlink()


def by_transforms(capture, name="../outside/003.png"):
    shutil.rmtree(capture / "sparse")
    document = json.loads((capture / "transforms.json").read_text())
    for frame in document["frames"]:
        if frame["file_path"].endswith("003.png"):
            frame["file_path"] = name
    (capture / "transforms.json").write_text(json.dumps(document))
    (capture / "images/003.png").unlink()


def by_absolute_path(capture):
    by_transforms(capture, str(capture.parent / "outside/003.png"))


def by_masks(capture):
    shutil.move(capture / "masks", capture.parent / "masks")
    (capture / "masks").symlink_to(capture.parent / "masks")


def by_mesh(capture):
    shutil.move(capture / "mesh.ply", capture.parent / "mesh.ply")
    (capture / "mesh.ply").symlink_to(capture.parent / "mesh.ply")


def linked(name):
    """Move a file or folder of the capture out of it and leave a link."""

    def leave(capture):
        shutil.move(capture / name, capture.parent / "outside/moved")
        (capture / name).symlink_to(capture.parent / "outside/moved")

    return leave


def by_exposures(capture):
    photos = sorted(path.name for path in (capture / "images").iterdir())
    lines = ["file,relative_exposure_stops", *(f"{name},0" for name in photos)]
    (capture / "exposure.csv").write_text("\n".join(lines))
    linked("exposure.csv")(capture)


LINKED = [
    linked(name) for name in ("sparse", "sparse/0", "sparse/0/images.txt", "sparse/0/cameras.txt", "transforms.json")
]


@pytest.mark.parametrize(
    "leave",
    [
        *(by_link, by_linked_folder, by_colmap, by_transforms, by_absolute_path, by_masks, by_mesh, by_exposures),
        *LINKED,
    ],
)
def test_outside_is_for_those_who_allow_it(capture, leave):
    leave(capture)
    with pytest.raises(CaptureError, match=r"lies outside the capture .*ingest\.allow_outside=true"):
        read_capture(capture)
    found = read_capture(capture, ALLOWED)
    assert len(found.train) == 14


def test_links_inside_need_no_leave(capture):
    (capture / "images/003.png").rename(capture / "photo")
    (capture / "images/003.png").symlink_to("../photo")
    assert len(read_capture(capture).train) == 14


def test_the_stage_takes_the_setting(capture, tmp_path):
    by_link(capture)
    with pytest.raises(CaptureError, match="allow_outside"):
        run(Inputs(capture, tmp_path / "a"), IngestConfig())
    assert run(Inputs(capture, tmp_path / "b"), IngestConfig(allow_outside=True)).views.is_file()


def test_a_view_cannot_be_called_as_it_likes(capture, tmp_path):
    views = run(Inputs(capture, tmp_path / "a"), IngestConfig()).views
    document = json.loads(views.read_text())
    for name in ("../../../escaped", "/escaped", "a\\b", "..", "a\0b", ""):
        document["test"][0]["name"] = name
        views.write_text(json.dumps(document))
        with pytest.raises(FormatError, match=r"test\.0\.name.* no name for the files of a view"):
            Views.read(views, "not a views file", "ingest")


def test_an_asset_has_no_links_out(tmp_path):
    folder, outside = tmp_path / "asset", tmp_path / "outside"
    for each in (folder, outside):
        each.mkdir()
    (outside / "layers.exr").write_bytes(b"x")
    (folder / "texture").symlink_to(outside)
    index = {"schema_version": 1, "textures": [{"name": "t", "layers": "texture/layers.exr"}]}
    (folder / "asset.json").write_text(json.dumps(index))
    with pytest.raises(FormatError, match="leads out"):
        read_index(folder)


def test_bundler_and_metashape_find_only_in_the_folder(capture):
    from ibrpipe.io.cameras.shots import PhotoFolder

    shutil.move(capture.parent / "outside/003.png", capture.parent / "outside/900.png")
    assert PhotoFolder(capture / "images", closed=True).find("../../outside/900.png", capture) is None
    shutil.rmtree(capture / "sparse")
    (capture / "transforms.json").unlink()
    (capture / "list.txt").write_text("../../outside/900.png\n")
    rows = ["100 0 0", "1 0 0", "0 1 0", "0 0 1", "0 0 0"]
    (capture / "bundle.out").write_text("\n".join(["# Bundle", "1 0", *rows]) + "\n")
    with pytest.raises((CaptureError, MissingFileError), match="outside"):
        read_capture(capture)
