"""Whatever a reader raises is told in one line that names the file."""

import os
import zlib
from pathlib import Path

import pytest

from ibrpipe.errors import CaptureError, FormatError, MissingFileError, ResourceError, ShapeError
from ibrpipe.io.manifest import Hasher
from ibrpipe.io.untrusted.boundary import reader, told, utf8_text


@pytest.mark.parametrize(
    "error",
    [
        ValueError("two\nlines"),
        KeyError("k"),
        AssertionError(),
        OverflowError("o"),
        RecursionError(),
        zlib.error("z"),
        UnboundLocalError("u"),
        OSError(36, "File name too long"),
        ShapeError("s"),
        AttributeError("a" * 1000),
    ],
)
def test_foreign_errors_become_ours(error):
    @reader("export it again")
    def read(path):
        raise error

    with pytest.raises(FormatError, match=r"^folder/a\.x: damaged \(.+\); export it again$") as caught:
        read("folder/a.x")
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 300


@pytest.mark.parametrize("error", [CaptureError("c"), MissingFileError("m"), ShapeError("folder/a.x: s")])
def test_our_errors_pass(error):
    with pytest.raises(type(error)) as caught, told("folder/a.x", "r"):
        raise error
    assert caught.value is error


def test_missing_files_and_memory():
    with pytest.raises(MissingFileError, match="nowhere: does not exist"), told("nowhere", "r"):
        Path("nowhere").read_bytes()
    with pytest.raises(ResourceError, match="more memory"), told("a", "r"):
        raise MemoryError("1 PiB")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no named pipes here")
def test_pipes_and_devices_are_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path / "pipe", "/dev/zero"):
        with pytest.raises(FormatError, match="named pipe"):
            utf8_text(path, "r")
    with pytest.raises(FormatError, match="pipe: is a named pipe"):
        Hasher().tree(tmp_path)


def test_loops_of_links_are_told(tmp_path):
    (tmp_path / "loop").symlink_to("..")
    with pytest.raises(FormatError, match="loop: is a link to a folder around it"):
        Hasher().tree(tmp_path)
    (tmp_path / "loop").unlink()
    (tmp_path / "self").symlink_to("self")
    with pytest.raises(FormatError, match="self: cannot be read"):
        Hasher().tree(tmp_path)


def test_what_is_no_text(tmp_path):
    (tmp_path / "a").write_bytes(b"\xff")
    with pytest.raises(FormatError, match="not UTF-8 text"):
        utf8_text(tmp_path / "a", "export it again")
    (tmp_path / "a").write_bytes(b"\xef\xbb\xbfx")
    assert utf8_text(tmp_path / "a", "r") == "x"
