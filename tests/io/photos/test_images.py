import numpy as np
import OpenImageIO as oiio
import pytest

from ibrpipe.core.color import srgb_decode
from ibrpipe.errors import FormatError, MissingFileError, ShapeError
from ibrpipe.io.photos.image_files import read_header
from ibrpipe.io.photos.images import read_coverage, read_depth, read_image, write_exr, write_png


@pytest.fixture
def picture(rng):
    return rng.random((7, 11, 3)).astype(np.float32)


@pytest.fixture
def rng():
    return np.random.default_rng(7)


def store(path, pixels, **attributes):
    """Write pixels as they are, in their own dtype."""
    pixels = pixels[:, :, None] if pixels.ndim == 2 else pixels
    height, width, channels = pixels.shape
    spec = oiio.ImageSpec(width, height, channels, str(pixels.dtype).replace("float32", "float"))
    for name, value in attributes.items():
        spec.attribute(name.replace("__", ":"), value)
    target = oiio.ImageOutput.create(str(path))
    assert target.open(str(path), spec), target.geterror()
    assert target.write_image(np.ascontiguousarray(pixels))
    target.close()
    return path


@pytest.mark.parametrize(
    ("suffix", "dtype"), [("png", "uint8"), ("png", "uint16"), ("tif", "uint8"), ("tif", "uint16")]
)
def test_integer_files_are_taken_as_srgb(tmp_path, rng, suffix, dtype):
    top = np.iinfo(dtype).max
    codes = rng.integers(0, top + 1, (7, 11, 3)).astype(dtype)
    linear = read_image(store(tmp_path / f"a.{suffix}", codes))
    assert linear.dtype == np.float32
    assert np.allclose(linear, srgb_decode(codes / np.float64(top)), rtol=1e-6, atol=0)


def test_jpeg_is_read_within_its_own_loss(tmp_path):
    codes = np.full((16, 16, 3), (200, 100, 50), np.uint8)
    linear = read_image(store(tmp_path / "a.jpg", codes))
    assert np.allclose(linear, srgb_decode(codes / 255.0), atol=0.02)


def test_float_files_are_taken_as_linear(tmp_path, picture):
    assert (read_image(store(tmp_path / "a.exr", picture * 5)) == picture * 5).all()
    assert (read_image(store(tmp_path / "a.tif", picture * 5)) == picture * 5).all()


def test_declared_color_space_overrides(tmp_path, rng):
    codes = rng.integers(0, 256, (4, 4, 3)).astype(np.uint8)
    path = store(tmp_path / "a.png", codes)
    assert np.allclose(read_image(path, "lin_rec709_scene"), codes / 255.0, atol=1e-7)


def test_adobe_rgb_green_leaves_rec709(tmp_path):
    codes = np.zeros((2, 2, 3), np.uint8)
    codes[:, :, 1] = 255
    linear = read_image(store(tmp_path / "a.png", codes), "AdobeRGB")
    # Adobe RGB (1998) annex C: its green primary in linear Rec.709, same white point D65
    assert np.allclose(linear[0, 0], (-0.3982, 1.0, -0.0429), atol=2e-3)


def test_grey_values_stay_grey_in_other_spaces(tmp_path):
    codes = np.full((2, 2, 3), 128, np.uint8)
    linear = read_image(store(tmp_path / "a.png", codes), "srgb_p3d65_scene")
    assert np.allclose(linear, srgb_decode(128 / 255.0), atol=1e-4)


def test_unknown_color_space_is_told(tmp_path, picture):
    with pytest.raises(FormatError, match="unknown colour space 'banana'; expected"):
        read_image(store(tmp_path / "a.exr", picture), "banana")


@pytest.mark.parametrize("orientation", range(1, 9))
def test_orientation_agrees_with_openimageio(tmp_path, rng, orientation):
    codes = rng.integers(0, 256, (5, 8, 3)).astype(np.uint8)
    path = store(tmp_path / "a.tif", codes, Orientation=orientation)
    expected = oiio.ImageBufAlgo.reorient(oiio.ImageBuf(str(path))).get_pixels(oiio.UINT8)
    upright = read_image(path)
    assert np.allclose(upright, srgb_decode(np.asarray(expected) / 255.0), atol=1e-6)
    assert read_header(path).upright_size == (upright.shape[1], upright.shape[0])
    assert read_image(path, oriented=False).shape[:2] == (5, 8)


def test_png_round_trip_within_half_a_code(tmp_path, picture):
    alpha = picture[:, :, 0]
    write_png(tmp_path / "a.png", picture, alpha)
    back = read_image(tmp_path / "a.png")
    assert np.abs(back[:, :, 3] - alpha).max() <= 0.5 / 255 + 1e-6
    codes = (back[:, :, :3], picture)
    from ibrpipe.core.color import srgb_encode

    assert np.abs(srgb_encode(codes[0]) - srgb_encode(codes[1])).max() <= 0.5 / 255 + 1e-6


def test_exr_round_trip_is_exact_and_repeatable(tmp_path, picture):
    planes = {name: picture[:, :, i] for i, name in enumerate("RGB")}
    planes |= {"A": np.ones((7, 11), np.float32), "Z": picture[:, :, 0] + 1}
    write_exr(tmp_path / "a.exr", planes)
    write_exr(tmp_path / "b.exr", planes)
    assert (read_image(tmp_path / "a.exr")[:, :, :3] == picture).all()
    assert (read_depth(tmp_path / "a.exr") == planes["Z"]).all()
    assert (tmp_path / "a.exr").read_bytes() == (tmp_path / "b.exr").read_bytes()
    assert b"2000:01:01" in (tmp_path / "a.exr").read_bytes()  # not the time of writing


def test_half_exr_holds_16_bit_floats(tmp_path, picture):
    write_exr(tmp_path / "a.exr", picture, half=True)
    back = read_image(tmp_path / "a.exr")
    assert (back == picture.astype(np.float16).astype(np.float32)).all()
    assert not (back == picture).all()


def test_premultiplied_exr_comes_back_straight(tmp_path, picture):
    alpha = np.full((7, 11, 1), 0.25, np.float32)
    write_exr(tmp_path / "a.exr", np.concatenate([picture * alpha, alpha], axis=2))
    assert np.allclose(read_image(tmp_path / "a.exr")[:, :, :3], picture, rtol=1e-6)


def test_straight_png_alpha_does_not_darken_colours(tmp_path):
    codes = np.full((3, 3, 4), 180, np.uint8)
    codes[:, :, 3] = 10
    path = store(tmp_path / "a.png", codes, oiio__UnassociatedAlpha=1)
    assert np.allclose(read_image(path)[:, :, :3], srgb_decode(180 / 255.0), rtol=1e-6)


def test_exr_overscan_is_placed_on_the_display_window(tmp_path):
    spec = oiio.ImageSpec(4, 3, 1, "float")
    spec.x, spec.y, spec.full_x, spec.full_y, spec.full_width, spec.full_height = 2, 1, 0, 0, 8, 6
    target = oiio.ImageOutput.create(str(tmp_path / "a.exr"))
    target.open(str(tmp_path / "a.exr"), spec)
    target.write_image(np.ones((3, 4, 1), np.float32))
    target.close()
    expected = np.zeros((6, 8, 1), np.float32)
    expected[1:4, 2:6] = 1
    assert (read_image(tmp_path / "a.exr") == expected).all()


def test_non_ascii_paths_work(tmp_path, picture):
    folder = tmp_path / "Fotos ä 写真"
    folder.mkdir()
    write_png(folder / "é.png", picture)
    assert read_image(folder / "é.png").shape == (7, 11, 3)


def test_coverage_is_not_gamma_decoded(tmp_path):
    codes = np.array([[0, 51, 255]], np.uint8)
    assert np.allclose(read_coverage(store(tmp_path / "m.png", codes)), [[0, 0.2, 1]], atol=1e-6)


def test_masks_of_zeros_and_ones_count_fully(tmp_path):
    codes = np.array([[0, 1, 1]], np.uint8)
    assert (read_coverage(store(tmp_path / "m.png", codes)) == [[0, 1, 1]]).all()


def test_depth_marks_nothing_as_infinite(tmp_path):
    depth = np.array([[0.0, 1.5], [np.nan, -2.0], [np.inf, 3.0]], np.float32)
    expected = np.array([[np.inf, 1.5], [np.inf, np.inf], [np.inf, 3.0]], np.float32)
    np.save(tmp_path / "d.npy", depth)
    store(tmp_path / "d.exr", depth)
    assert (read_depth(tmp_path / "d.npy") == expected).all()
    assert (read_depth(tmp_path / "d.exr") == expected).all()


@pytest.mark.parametrize("keep", [0, 100, 0.5, 0.98])
@pytest.mark.parametrize("suffix", ["png", "jpg"])
def test_truncated_files_are_told(tmp_path, rng, suffix, keep):
    path = store(tmp_path / f"a.{suffix}", rng.integers(0, 256, (200, 300, 3)).astype(np.uint8))
    data = path.read_bytes()
    path.write_bytes(data[: keep if isinstance(keep, int) else int(len(data) * keep)])
    with pytest.raises(FormatError, match=rf"a\.{suffix}: .*(cannot be read|damaged)"):
        read_image(path)


def test_text_is_no_image(tmp_path):
    (tmp_path / "a.png").write_text("hello")
    with pytest.raises(FormatError, match="cannot be read as an image"):
        read_image(tmp_path / "a.png")


def test_missing_file_is_told(tmp_path):
    with pytest.raises(MissingFileError, match="does not exist"):
        read_image(tmp_path / "a.png")


def test_bad_depth_files_are_told(tmp_path):
    np.save(tmp_path / "d.npy", np.zeros((2, 3, 4)))
    with pytest.raises(FormatError, match=r"must be a float array \(H, W\), got float64 \(2, 3, 4\)"):
        read_depth(tmp_path / "d.npy")
    (tmp_path / "e.npy").write_bytes(b"no")
    with pytest.raises(FormatError, match="not a NumPy array file"):
        read_depth(tmp_path / "e.npy")
    store(tmp_path / "d.png", np.ones((2, 2), np.uint8))
    with pytest.raises(FormatError, match="stored as uint8 integers"):
        read_depth(tmp_path / "d.png")


def test_writers_refuse_shapes_that_are_no_pictures(tmp_path):
    with pytest.raises(ShapeError, match=r"must be \(H, W\)"):
        write_png(tmp_path / "a.png", np.zeros((3,)))
    with pytest.raises(ShapeError, match="one size"):
        write_exr(tmp_path / "a.exr", {"R": np.zeros((2, 2)), "G": np.zeros((3, 2))})
