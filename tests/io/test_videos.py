"""Videos that phones play: what is in the file, and that its colours are those of the pictures."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ibrpipe.errors import ShapeError
from ibrpipe.io.photos.images import write_png
from ibrpipe.io.videos.write import write_video

#: linear colours far from grey, where BT.601 and BT.709 differ most
COLORS = np.array([[0.8, 0.05, 0.02], [0.03, 0.6, 0.05], [0.02, 0.05, 0.7]], np.float32)


def pictures(folder: Path, height: int = 33, width: int = 49) -> list[Path]:
    files = []
    for number, color in enumerate(COLORS):
        files.append(folder / f"{number}.png")
        write_png(files[-1], np.broadcast_to(color, (height, width, 3)))
    return files


def test_it_is_h264_that_phones_play(tmp_path: Path) -> None:
    av = pytest.importorskip("av")
    assert write_video(tmp_path / "a.mp4", pictures(tmp_path), 12.5) == ""
    content = (tmp_path / "a.mp4").read_bytes()
    assert 0 < content.index(b"moov") < content.index(b"mdat")  # the index first: it plays while it loads
    with av.open(str(tmp_path / "a.mp4")) as container:
        stream = container.streams.video[0]
        assert (stream.codec_context.name, stream.pix_fmt, float(stream.average_rate)) == ("h264", "yuv420p", 12.5)
        assert (stream.width, stream.height) == (50, 34)  # 4:2:0 has even sides
        frames = [frame.to_ndarray(format="rgb24") for frame in container.decode(stream)]
    assert len(frames) == 3
    for frame, color in zip(frames, COLORS):
        code = 255 * (1.055 * color ** (1 / 2.4) - 0.055)
        # levels of YCbCr in 8 bits; the matrix of BT.601 would be 20 levels off in green
        np.testing.assert_allclose(frame[16, 24], code, atol=4)


def test_pictures_of_another_size_are_refused(tmp_path: Path) -> None:
    files = pictures(tmp_path)
    write_png(files[2], np.zeros((20, 20, 3), np.float32))
    with pytest.raises(ShapeError, match=r"2\.png: is 20 x 20 but the video is 49 x 33"):
        write_video(tmp_path / "a.mp4", files, 10)
    assert not (tmp_path / "a.mp4").exists()
