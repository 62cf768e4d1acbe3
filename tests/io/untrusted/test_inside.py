"""Names that lead out of a folder, by their words or by links."""

import pytest

from ibrpipe.errors import FormatError
from ibrpipe.io.untrusted.inside import inside, is_file_name, leads_inside


@pytest.fixture
def root(tmp_path):
    folder = tmp_path / "root"
    (folder / "below").mkdir(parents=True)
    (tmp_path / "secret").write_text("s")
    (folder / "link").symlink_to(tmp_path)
    (folder / "loop").symlink_to("loop")
    (folder / "inner").symlink_to("below")
    return folder


@pytest.mark.parametrize("name", ["a.png", "below/a.png", "below/../a.png", "inner/a.png", "not/yet/there", "ä b"])
def test_what_stays_inside(root, name):
    assert inside(root, name, root / "file", "x") == root / name


@pytest.mark.parametrize(
    "name",
    [
        "../secret",
        "below/../../secret",
        "/etc/passwd",
        "C:\\x",
        "\\\\host\\x",
        "link/secret",
        "loop",
        "",
        "a\x00b",
        "x" * 300,
        "x/" * 5000 + "y",
    ],
)
def test_what_leads_out(root, name):
    with pytest.raises(FormatError, match=r"file: .* copy it") as caught:
        inside(root, name, root / "file", "copy it")
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 1000


def test_a_root_that_is_a_link_holds_what_is_in_it(root, tmp_path):
    (tmp_path / "other").symlink_to(root)
    assert leads_inside(tmp_path / "other", tmp_path / "other/below/a")
    assert leads_inside(root, tmp_path / "other/below/a")


@pytest.mark.parametrize("name", ["003", "photos__a_jpg", "a b", "ä", "..a"])
def test_names_of_files(name):
    assert is_file_name(name)


@pytest.mark.parametrize("name", ["", ".", "..", "../../x", "/x", "a\\b", "a\nb", "a\0", "C:x", "n" * 300])
def test_no_names_of_files(name):
    assert not is_file_name(name)
