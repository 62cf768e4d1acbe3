import numpy as np
import pytest

from ibrpipe.core.color import decode_table, luminance, srgb_decode, srgb_encode, to_bytes


def decode_plainly(code):
    """IEC 61966-2-1, one number at a time."""
    return code / 12.92 if code <= 0.04045 else ((code + 0.055) / 1.055) ** 2.4


def test_decode_follows_the_standard():
    codes = np.linspace(0.0, 1.0, 1001)
    assert np.allclose(srgb_decode(codes), [decode_plainly(code) for code in codes], rtol=1e-12, atol=0)


@pytest.mark.parametrize(("dtype", "tolerance"), [(np.float32, 2e-7), (np.float64, 4e-8)])
def test_encode_undoes_decode(dtype, tolerance):
    # the standard's two thresholds do not match exactly: 4e-8 is its own gap
    codes = np.linspace(0.0, 1.0, 4001).astype(dtype)
    back = srgb_encode(srgb_decode(codes))
    assert back.dtype == dtype
    assert np.abs(back - codes).max() <= tolerance


def test_encode_clips_and_keeps_nan():
    coded = srgb_encode(np.array([-1.0, 0.0, 1.0, 7.0, np.nan]))
    assert coded[:4] == pytest.approx([0.0, 0.0, 1.0, 1.0], abs=1e-15)
    assert np.isnan(coded[4])


def test_every_byte_survives_decoding_and_encoding():
    codes = np.arange(256)
    assert (to_bytes(srgb_encode(decode_table(256))) == codes).all()


def test_every_16_bit_code_survives():
    codes = np.arange(65536)
    assert (np.rint(srgb_encode(decode_table(65536).astype(np.float64)) * 65535) == codes).all()


def test_luminance_of_white_is_one():
    assert luminance(np.ones((2, 3, 3))) == pytest.approx(np.ones((2, 3)), abs=1e-12)
    assert luminance(np.array([0.0, 1.0, 0.0])) == pytest.approx(0.7152)
