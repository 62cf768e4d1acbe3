"""Array files that claim more than they hold, or unpack to more than anyone wants."""

import io
import zipfile

import numpy as np
import pytest

from ibrpipe.errors import FormatError, MissingFileError
from ibrpipe.io.untrusted import arrays
from ibrpipe.io.untrusted.arrays import load_npy, load_npz


@pytest.mark.parametrize("array", [np.arange(12.0).reshape(3, 4), np.asfortranarray(np.eye(3, 2)), np.float32(2)])
def test_what_numpy_writes_comes_back(tmp_path, array):
    np.save(tmp_path / "a.npy", array)
    found = load_npy(tmp_path / "a.npy")
    np.testing.assert_array_equal(found, array)
    assert found.dtype == array.dtype
    assert found.flags.writeable
    np.savez_compressed(tmp_path / "a.npz", one=array, two=array)
    assert set(load_npz(tmp_path / "a.npz")) == {"one", "two"}
    np.testing.assert_array_equal(load_npz(tmp_path / "a.npz")["two"], array)


def claiming(shape):
    """An array file of 8 bytes whose header claims `shape`."""
    stored = io.BytesIO()
    np.lib.format.write_array_header_1_0(stored, {"descr": "<f4", "fortran_order": False, "shape": shape})
    return stored.getvalue() + bytes(8)


@pytest.mark.parametrize("shape", [(100_000_000_000,), (1 << 40, 1 << 40), (3,), (-1, 2)])
def test_a_claim_is_not_believed(tmp_path, shape):
    (tmp_path / "a.npy").write_bytes(claiming(shape))
    with pytest.raises(FormatError, match=r"a\.npy: not a NumPy array file \(.*; write it with numpy.save"):
        load_npy(tmp_path / "a.npy")
    with zipfile.ZipFile(tmp_path / "a.npz", "w") as archive:
        archive.writestr("a.npy", claiming(shape))
    with pytest.raises(FormatError, match=r"a\.npz: not a NumPy archive"):
        load_npz(tmp_path / "a.npz")


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04", b"\x93NUMPY\x01\x00\xff\xff{", b"\x93NUMPY\x07\x00\x00\x00"])
def test_damage_is_told(tmp_path, content):
    (tmp_path / "a.npy").write_bytes(content)
    with pytest.raises(FormatError, match="not a NumPy"):
        load_npy(tmp_path / "a.npy")
    with pytest.raises(FormatError, match="not a NumPy"):
        load_npz(tmp_path / "a.npy")
    with pytest.raises(MissingFileError):
        load_npy(tmp_path / "b.npy")


def test_objects_are_never_made(tmp_path):
    np.save(tmp_path / "a.npy", np.array([print], object), allow_pickle=True)
    with pytest.raises(FormatError, match="Python objects"):
        load_npy(tmp_path / "a.npy")


def test_a_bomb_is_not_unpacked(tmp_path, monkeypatch):
    np.savez_compressed(tmp_path / "a.npz", a=np.zeros(1 << 20, np.uint8))
    monkeypatch.setattr(arrays, "MOST_BYTES", 1 << 19)
    with pytest.raises(FormatError, match="unpacks to 1 MiB; at most 0"):
        load_npz(tmp_path / "a.npz")
