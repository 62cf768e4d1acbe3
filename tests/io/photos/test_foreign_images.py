"""Images as renderers, cameras and editors write them: layers, depth, profiles, exposures, names."""

import os
import shutil
import struct
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from ibrpipe.core.color import srgb_decode
from ibrpipe.errors import FormatError
from ibrpipe.io.photos.channel_names import best_part, plain_names
from ibrpipe.io.photos.exposure import gains_from_partial_exif
from ibrpipe.io.photos.icc import read_profile
from ibrpipe.io.photos.image_files import ImageHeader, read_header
from ibrpipe.io.photos.images import read_depth, read_image, write_exr


def layers(rng, alpha):
    picture = rng.random((6, 8, 3)).astype(np.float32)
    planes = {f"ViewLayer.Combined.{name}": picture[:, :, n] * alpha for n, name in enumerate("RGB")}
    depth = np.where(alpha > 0, np.float32(2.5), np.float32(1e10))
    planes |= {"ViewLayer.Combined.A": alpha, "ViewLayer.Depth.Z": depth}
    planes |= {f"ViewLayer.Normal.{name}": np.full((6, 8), -1, np.float32) for name in "XYZ"}
    planes |= {f"ViewLayer.DiffCol.{name}": np.zeros((6, 8), np.float32) for name in "RGB"}
    return picture, planes


def test_multilayer_files_have_colour_alpha_and_depth(tmp_path):
    alpha = np.zeros((6, 8), np.float32)
    alpha[1:4, 2:7] = 1
    picture, planes = layers(np.random.default_rng(0), alpha)
    write_exr(tmp_path / "a.exr", planes)
    read = read_image(tmp_path / "a.exr")
    assert read_header(tmp_path / "a.exr").has_alpha
    assert (read[:, :, 3] == alpha).all()
    assert np.allclose(read[alpha > 0][:, :3], picture[alpha > 0], atol=1e-6)
    assert (read_depth(tmp_path / "a.exr") == np.where(alpha > 0, np.float32(2.5), np.inf)).all()


NAMES = {
    ("R", "G", "B", "Depth.R"): ("R", "G", "B", "Depth.R"),
    ("V",): ("Z",),
    ("Depth.V", "Noise.V"): ("Z", "Noise.V"),
    ("Normal.X", "Normal.Y", "Normal.Z"): ("Normal.X", "Normal.Y", "Normal.Z"),
    ("diffuse.R", "diffuse.G", "diffuse.B", "rgba.R", "rgba.G", "rgba.B", "rgba.A"): (
        "diffuse.R",
        "diffuse.G",
        "diffuse.B",
        "R",
        "G",
        "B",
        "A",
    ),
    ("Y", "A"): ("Y", "A"),
}


@pytest.mark.parametrize("names", NAMES)
def test_channels_by_their_plain_names(names):
    assert plain_names(names) == NAMES[names]


@pytest.mark.parametrize("half", [True, False])
def test_backgrounds_of_depth_are_nowhere(tmp_path, half):
    stored = np.array([[1.5, 65504.0, 3.0, 0.0, np.inf if half else 1e10]] * 2, np.float32)
    write_exr(tmp_path / "d.exr", {"V": stored}, half=half)
    assert read_depth(tmp_path / "d.exr").tolist() == [[1.5, np.inf, 3.0, np.inf, np.inf]] * 2


# profiles


def xyz(values):
    return b"XYZ \0\0\0\0" + struct.pack(">3i", *(round(value * 65536) for value in values))


def gamma(value):
    return b"curv\0\0\0\0" + struct.pack(">IH", 1, round(value * 256))


def table(values):
    return b"curv\0\0\0\0" + struct.pack(f">I{len(values)}H", len(values), *(round(v * 65535) for v in values))


def parametric(kind, *values):
    return b"para\0\0\0\0" + struct.pack(f">HH{len(values)}i", kind, 0, *(round(v * 65536) for v in values))


def profile(kind=b"RGB ", **tags):
    head, body = bytearray(128), b""
    head[16:20], head[20:24] = kind, b"XYZ "
    rows, start = [], 132 + 12 * len(tags)
    for name, content in tags.items():
        rows.append(struct.pack(">4sII", name.encode(), start + len(body), len(content)))
        body += content + b"\0" * (-len(content) % 4)
    return bytes(head) + struct.pack(">I", len(tags)) + b"".join(rows) + body


#: Colorants relative to D50, as the profiles of these spaces hold them
PROPHOTO = {"r": (0.79767, 0.28804, 0.0), "g": (0.13519, 0.71188, 0.0), "b": (0.03134, 0.00009, 0.82491)}
SRGB = {"r": (0.43607, 0.22249, 0.01392), "g": (0.38515, 0.71687, 0.09708), "b": (0.14307, 0.06061, 0.7141)}


def of_colorants(colorants, curve):
    tags = {f"{name}XYZ": xyz(values) for name, values in colorants.items()}
    return profile(**tags, **{f"{name}TRC": curve for name in "rgb"})


CURVES = {
    "parametric": parametric(3, 2.4, 1 / 1.055, 0.055 / 1.055, 1 / 12.92, 0.04045),
    "table": table(srgb_decode(np.linspace(0, 1, 4096))),
}


@pytest.mark.parametrize("curve", CURVES)
def test_the_profile_of_srgb_is_srgb(curve):
    stored = np.random.default_rng(1).random((5, 7, 3))
    found = read_profile(of_colorants(SRGB, CURVES[curve]), 3).linear(stored)
    assert np.abs(found - srgb_decode(stored)).max() < 5e-4  # the colorants have five digits


def with_profile(path, codes, data):
    import OpenImageIO as oiio

    spec = oiio.ImageSpec(codes.shape[1], codes.shape[0], codes.shape[2], str(codes.dtype))
    spec.attribute("ICCProfile", f"uint8[{len(data)}]", np.frombuffer(data, np.uint8))
    target = oiio.ImageOutput.create(str(path))
    assert target.open(str(path), spec)
    assert target.write_image(codes)
    assert target.close()


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_prophoto_is_honoured(tmp_path, dtype):
    """Green of ProPhoto lies outside Rec.709; white stays white."""
    full = np.iinfo(dtype).max
    codes = np.array([[[1, 1, 1], [0, 1, 0], [0.5, 0.5, 0.5]]]) * full
    with_profile(tmp_path / "a.tif", codes.astype(dtype), of_colorants(PROPHOTO, gamma(1.8)))
    white, green, grey = read_image(tmp_path / "a.tif")[0]
    assert np.abs(white - 1).max() < 2e-3
    wanted = np.array([-0.7286, 1.2316, -0.1534])  # Lindbloom: ProPhoto to XYZ, Bradford, XYZ to sRGB
    assert np.abs(green - wanted).max() < 0.01
    assert np.abs(grey - (np.floor(0.5 * full) / full) ** 1.8).max() < 2e-3
    assert (read_image(tmp_path / "a.tif", "srgb_rec709_scene")[0, 1] == [0, 1, 0]).all()


def test_grey_profiles(tmp_path):
    codes = np.full((2, 2, 1), 128, np.uint8)
    with_profile(tmp_path / "a.tif", codes, profile(b"GRAY", kTRC=gamma(1.8)))
    assert read_image(tmp_path / "a.tif")[0, 0, 0] == pytest.approx((128 / 255) ** (461 / 256), abs=1e-5)


def test_profiles_of_tables_and_damaged_ones_are_told(tmp_path):
    for data, words in ((profile(A2B0=b"mft2" * 8), "is made of tables"), (profile()[:130], "is damaged")):
        with_profile(tmp_path / "a.tif", np.zeros((2, 2, 3), np.uint8), data)
        with pytest.raises(FormatError, match=f"a.tif: its ICC profile {words}"):
            read_image(tmp_path / "a.tif")
        assert read_image(tmp_path / "a.tif", "srgb_rec709_scene").shape == (2, 2, 3)


# exposure


def shot(time=0.02, aperture=2.5, iso=800.0):
    figures = {"ExposureTime": time, "FNumber": aperture, "Exif:PhotographicSensitivity": iso}
    return ImageHeader(4, 3, ("R",), True, 1, "x", figures)


def test_a_manual_lens_leaves_time_and_iso():
    gains, told = gains_from_partial_exif([shot(aperture=0), shot(aperture=0), shot(0.04, aperture=0)], "abc")
    assert gains == pytest.approx([1, 1, 0.5])
    assert "no photo states its f-number, which counts as the same for all" in told


def test_one_photo_without_f_number_does_not_switch_all_off():
    gains, told = gains_from_partial_exif([shot(), shot(aperture=0), shot(0.04)], "abc")
    assert gains == pytest.approx([1, 1, 0.5])
    assert "1 of 3 photos state no f-number (b), 2.5 is taken for them" in told


def test_without_times_nothing_is_known():
    assert gains_from_partial_exif([shot(time=0), shot(time=0)], "ab") == (None, "")
    gains, told = gains_from_partial_exif([shot(time=0), shot(time=0), shot()], "abc")
    assert gains is None
    assert "only 1 of 3 photos state an exposure time" in told


# names


@pytest.mark.skipif(os.name != "posix", reason="other systems have no such names")
def test_names_that_are_not_utf8_are_told(tiny_ball, tmp_path):
    from ibrpipe.cli.main import cli

    root = Path(os.fsdecode(os.fsencode(tmp_path) + b"/Aufnahme_\xe4"))
    try:
        shutil.copytree(tiny_ball, root)
    except OSError:
        pytest.skip("this file system refuses such names")
    with pytest.raises(FormatError, match=r"Aufnahme_\\xe4/images/000.png: the name of the file or of a folder is not"):
        read_header(root / "images/000.png")
    result = CliRunner().invoke(cli, ["run", "mesh", "--capture", str(root), "--out", str(tmp_path / "out")])
    assert result.exit_code == 1
    assert "not UTF-8" in result.stderr
    assert result.stderr.count("error:") == 1


PARTS = {
    "plain": [("", ("R", "G", "B", "A")), ("", ("Z",))],
    "named": [
        ("ViewLayer.Depth", ("Z",)),
        ("ViewLayer.Normal", ("X", "Y", "Z")),
        ("ViewLayer.Combined", ("R", "G", "B")),
    ],
    "passes": [("DiffCol", ("R", "G", "B")), ("Composite", ("R", "G", "B", "A")), ("Depth", ("V",))],
}
WANTED = {"plain": (0, 1), "named": (2, 0), "passes": (1, 2)}


@pytest.mark.parametrize("case", PARTS)
def test_the_part_of_the_picture_and_that_of_depth(case):
    assert (best_part(PARTS[case], "R"), best_part(PARTS[case], "Z")) == WANTED[case]


def test_multipart_files_have_picture_and_depth(tmp_path):
    import OpenEXR

    depth, picture = np.full((4, 6), 3.5, np.float32), np.full((4, 6), 0.25, np.float32)
    parts = [
        OpenEXR.Part({"name": "Depth", "type": OpenEXR.scanlineimage}, {"Z": depth}),
        OpenEXR.Part({"name": "Combined", "type": OpenEXR.scanlineimage}, dict.fromkeys("RGB", picture)),
    ]
    OpenEXR.File(parts).write(str(tmp_path / "a.exr"))
    assert (read_image(tmp_path / "a.exr") == 0.25).all()
    assert read_image(tmp_path / "a.exr").shape == (4, 6, 3)
    assert (read_depth(tmp_path / "a.exr") == 3.5).all()


def test_colours_are_no_depth(tmp_path):
    write_exr(tmp_path / "c.exr", np.random.default_rng(2).random((4, 4, 3)))
    with pytest.raises(FormatError, match=r"c.exr: holds colours and no depth; expected a channel Z or V"):
        read_depth(tmp_path / "c.exr")
    write_exr(tmp_path / "g.exr", np.full((4, 4, 3), 2.0))
    assert (read_depth(tmp_path / "g.exr") == 2).all()


def test_profiles_of_printing_colours_are_told(tmp_path):
    with_profile(tmp_path / "a.tif", np.zeros((2, 2, 3), np.uint8), profile(b"CMYK"))
    with pytest.raises(FormatError, match="its ICC profile is of CMYK colours"):
        read_image(tmp_path / "a.tif")
