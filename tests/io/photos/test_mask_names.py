"""Masks as people have them: any naming that pairs, any way to say what counts; what pairs with nothing is told."""

import json
import shutil

import numpy as np
import pytest
from PIL import Image

from ibrpipe.errors import CaptureError
from ibrpipe.io.captures import read_capture
from ibrpipe.io.photos.images import read_coverage, write_png
from ibrpipe.stages.ingest import IngestConfig, Inputs, run

NAMES = {
    "suffix": "masks/{0}.jpg",
    "word behind": "masks/{0}_mask.png",
    "word before": "masks/segmentation-of-{0}.png",
    "capitals": "Masks/{0}.PNG",
    "sub-folder": "masks/all/{0}.png",
    "cut-out of a photo's name": "masks/{0}.png-removebg-preview.png",
    "other number of digits": "masks/frame{0:>06}.png",
}


@pytest.fixture
def capture(tiny_ball, tmp_path):
    root = shutil.copytree(tiny_ball, tmp_path / "capture")
    shutil.rmtree(root / "test")
    (root / "transforms.json").unlink()  # it names masks, too
    return root


def told(root, tmp_path):
    out = tmp_path / "out"
    out.mkdir(exist_ok=True)
    run(Inputs(root, out), IngestConfig())
    return (out / "summary.txt").read_text(encoding="utf-8")


@pytest.mark.parametrize("name", NAMES.values(), ids=NAMES)
def test_any_naming_that_pairs_is_understood(capture, tmp_path, name):
    (capture / "masks").rename(capture / "old")
    before = {}
    for path in sorted((capture / "old").iterdir()):
        target = capture / name.format(path.stem)
        target.parent.mkdir(parents=True, exist_ok=True)
        before[path.stem] = read_coverage(path).mean()
        if target.suffix == ".jpg":
            Image.open(path).convert("L").save(target, quality=90)
        else:
            path.rename(target)
    shutil.rmtree(capture / "old")
    found = read_capture(capture)
    assert found.warnings == ()
    for view in found.train + found.test:
        assert view.mask is not None
        assert view.name.lstrip("0") in view.mask.name
        assert read_coverage(view.mask).mean() == pytest.approx(before[view.name], abs=0.01)
    assert "14 masks are paired with photos by their names, such as" in told(capture, tmp_path)


def test_masks_may_have_the_shorter_names(capture):
    for folder, before in (("images", "Photo-"), ("masks", "")):
        for path in sorted((capture / folder).iterdir()):
            path.rename(path.with_name(f"{before}{chr(97 + int(path.stem))}.png"))
    lines = (capture / "sparse/0/images.txt").read_text().splitlines()
    for n, line in enumerate(lines):
        if line.endswith(".png"):
            name = line.rsplit(" ", 1)[1]
            lines[n] = line.removesuffix(name) + f"images/Photo-{chr(97 + int(name[:3]))}.png"
    (capture / "sparse/0/images.txt").write_text("\n".join(lines))
    found = read_capture(capture)
    assert {(view.image.stem, view.mask.stem) for view in found.train + found.test} == {
        (f"Photo-{chr(97 + n)}", chr(97 + n)) for n in range(14)
    }


def test_masks_of_no_photo_are_told(capture, tmp_path):
    for path in sorted((capture / "masks").iterdir()):
        path.rename(path.with_name(f"{chr(97 + int(path.stem))}bc.png"))
    text = told(capture, tmp_path)
    assert "14 of 14 masks belong to no photo, the first is masks/abc.png: call masks as their photos" in text


def test_one_mask_too_many_is_told_and_the_others_are_used(capture, tmp_path):
    shutil.copy(capture / "masks/000.png", capture / "masks/extra.png")
    assert "1 of 15 masks belong to no photo, the first is masks/extra.png" in told(capture, tmp_path)
    assert all(view.mask for view in read_capture(capture).train)


SHAPE = np.zeros((8, 10), np.uint8)
SHAPE[2:6, 3:8] = 1


def palette(colours):
    image = Image.fromarray(SHAPE, mode="P")
    image.putpalette([*colours, *[0] * (768 - len(colours))])
    return image


def cut_out(rng):
    pixels = rng.integers(0, 256, (8, 10, 4), dtype=np.uint8)
    pixels[:, :, 3] = 255 * SHAPE
    return Image.fromarray(pixels, mode="RGBA")


KINDS = {
    "one bit": lambda rng: Image.fromarray(255 * SHAPE).convert("1"),
    "dark labels": lambda rng: palette([0, 0, 0, 128, 0, 0]),
    "labels by number": lambda rng: Image.fromarray(SHAPE * np.where(np.arange(10) < 5, 1, 2).astype(np.uint8)),
    "colours": lambda rng: Image.fromarray(SHAPE[:, :, None] * np.array([0, 60, 200], np.uint8)),
    "grey and alpha": lambda rng: Image.merge("LA", [Image.new("L", (10, 8), 90), Image.fromarray(255 * SHAPE)]),
    "cut-out": cut_out,
    "opaque": lambda rng: Image.fromarray(255 * SHAPE).convert("RGBA"),
}


@pytest.mark.filterwarnings("ignore:'mode' parameter is deprecated")
@pytest.mark.parametrize("kind", KINDS)
def test_what_counts_is_read_from_every_kind_of_file(tmp_path, kind):
    KINDS[kind](np.random.default_rng(0)).save(tmp_path / "m.png")
    assert (read_coverage(tmp_path / "m.png") == SHAPE).all()


def test_an_opaque_black_mask_keeps_nothing(tmp_path):
    Image.new("RGBA", (10, 8), (0, 0, 0, 255)).save(tmp_path / "m.png")
    assert not read_coverage(tmp_path / "m.png").any()


def test_jpeg_masks_have_no_halo(tmp_path):
    Image.fromarray(np.kron(SHAPE, np.full((8, 8), 255, np.uint8))).save(tmp_path / "m.jpg", quality=85)
    found = read_coverage(tmp_path / "m.jpg")
    assert found[:8].max() == 0
    assert found[24:40, 32:56].min() == 1


def invert(root):
    for path in (root / "masks").iterdir():
        write_png(path, 1.0 - np.round(read_coverage(path)))


def test_inverted_masks_stop_with_the_remedy_where_a_mesh_shows_it(capture, tmp_path):
    invert(capture)
    with pytest.raises(CaptureError, match=r"masks look inverted: .*magick mogrify -negate masks"):
        told(capture, tmp_path)


def test_inverted_masks_are_told_without_a_mesh(capture, tmp_path):
    (capture / "mesh.ply").unlink()
    assert "inverted" not in told(capture, tmp_path)
    invert(capture)
    assert "masks keep the rim of the picture and leave out a part inside" in told(capture, tmp_path)
    document = json.loads((tmp_path / "out/audit.json").read_text())
    assert [each["kind"] for each in document["findings"] if "inverted" in each["kind"]] == ["inverted masks"]


def test_a_mesh_of_another_size_does_not_make_masks_inverted(capture, tmp_path):
    from ibrpipe.io.surfaces.meshes import read_mesh, write_mesh
    from ibrpipe.types import Mesh

    mesh = read_mesh(capture / "mesh.ply")
    for factor in (0.4, 2.2):
        write_mesh(Mesh(mesh.vertices * factor, mesh.faces), capture / "mesh.ply")
        assert "inverted" not in told(capture, tmp_path)
