"""Videos become captures of photos: which videos, what is written, what is told."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from ibrpipe.cli.main import cli
from ibrpipe.engine.runner import Event
from ibrpipe.errors import FormatError
from ibrpipe.io.manifest import Hasher
from ibrpipe.io.photos.images import read_image
from ibrpipe.io.videos.read import read_video_header
from ibrpipe.stages.stills import videos_of, with_photos

FRAMES, BLURRED = 40, (7, 16, 25, 34)


def write_film(path: Path, frames: int = FRAMES) -> Path:
    """A camera that moves along the wall of a synthetic photo, 4 pixels of 160 a frame, some frames out of focus."""
    import cv2

    source = cv2.imread(str(write_film.photo))  # type: ignore[attr-defined]
    wall = cv2.resize(source, (320, 240), interpolation=cv2.INTER_NEAREST)
    writer = cv2.VideoWriter(str(path), cv2.CAP_FFMPEG, cv2.VideoWriter.fourcc(*"mp4v"), 25, (160, 120))
    for frame in range(frames):
        picture = wall[60:180, 4 * frame : 4 * frame + 160]
        writer.write(cv2.GaussianBlur(picture, (0, 0), 4) if frame in BLURRED else picture)
    writer.release()
    return path


@pytest.fixture(autouse=True)
def _photo(tiny_lambert: Path) -> None:
    write_film.photo = sorted((tiny_lambert / "images").iterdir())[0]  # type: ignore[attr-defined]


@pytest.fixture
def taken(tmp_path: Path) -> Callable[..., tuple[Path, list[Event]]]:
    """Return a function that takes photos from a capture into ``out`` and returns their folder and what was told."""

    def take(capture: Path, frames: int = 10) -> tuple[Path, list[Event]]:
        events: list[Event] = []
        (tmp_path / "out").mkdir(exist_ok=True)
        return with_photos(capture, Hasher(), events.append, tmp_path / "out", frames), events

    return take


def test_a_film_becomes_a_folder_of_sharp_photos(tmp_path: Path, taken: Callable) -> None:
    film = write_film(tmp_path / "wall.mp4")
    folder, events = taken(film)
    assert folder == tmp_path / "out/stills/wall"
    numbers = [int(photo.stem.removeprefix("wall_")) for photo in sorted((folder / "images").iterdir())]
    assert len(numbers) == 10
    assert not set(numbers) & set(BLURRED)
    assert np.diff(numbers).min() >= 1
    assert np.diff(numbers).max() <= 8  # steps of 4 frames, the sharpest of each
    assert read_image(folder / "images" / f"wall_{numbers[0]:06d}.jpg").shape == (120, 160, 3)
    assert [event.kind for event in events] == ["starts", "done"]
    assert events[-1].text.startswith("wall.mp4: 10 of 40 frames are taken")
    assert "4 blurred left out" in events[-1].text


def test_a_second_time_nothing_is_done_and_bytes_repeat(tmp_path: Path, taken: Callable) -> None:
    film = write_film(tmp_path / "wall.mp4")
    folder, _ = taken(film)
    before = {photo.name: photo.read_bytes() for photo in (folder / "images").iterdir()}
    assert [event.kind for event in taken(film)[1]] == ["skipped"]
    assert [event.kind for event in taken(film, frames=5)[1]] == ["starts", "done"]
    again, events = taken(film)
    assert events[0].text == "settings changed: frames"
    assert {photo.name: photo.read_bytes() for photo in (again / "images").iterdir()} == before


def test_a_film_among_photos_joins_them(tmp_path: Path, tiny_lambert: Path, taken: Callable) -> None:
    capture = tmp_path / "capture"
    (capture / "images").mkdir(parents=True)
    for photo in sorted((tiny_lambert / "images").iterdir())[:3]:
        shutil.copy(photo, capture / "images")
    (capture / "exposure.csv").write_text("file,relative_exposure_stops\n")
    write_film(capture / "images/pan.mp4")
    folder, _ = taken(capture)
    names = sorted(path.name for path in (folder / "images").iterdir())
    assert [name for name in names if not name.startswith("pan_")] == ["000.png", "001.png", "002.png"]
    assert len(names) == 13
    assert (folder / "exposure.csv").is_file()


def test_videos_that_photos_stand_for_are_left(tmp_path: Path, tiny_lambert: Path, taken: Callable) -> None:
    film = write_film(tmp_path / "film.mp4", 3)
    for name in ("IMG_1.jpg", "IMG_1.mov", "IMG_2.mp4"):
        (tmp_path / "phone" / name).parent.mkdir(exist_ok=True)
        shutil.copy(film, tmp_path / "phone" / name)
    assert videos_of(tmp_path / "phone") == [tmp_path / "phone/IMG_2.mp4"]
    calibrated = Path(shutil.copytree(tiny_lambert, tmp_path / "calibrated"))
    shutil.copy(film, calibrated / "images")
    assert videos_of(calibrated) == []
    assert taken(calibrated) == (calibrated, [])


def test_links_out_of_the_capture_stay_links(tmp_path: Path, taken: Callable) -> None:
    capture = tmp_path / "capture"
    capture.mkdir()
    (tmp_path / "secret.png").write_bytes(b"x")
    (capture / "a.png").symlink_to(tmp_path / "secret.png")
    write_film(capture / "pan.mp4")
    folder, _ = taken(capture)
    assert (folder / "a.png").is_symlink()  # ingest refuses it as it would in the capture


@pytest.mark.parametrize(
    ("content", "words"), [(b"", "is empty"), (b"no video" * 500, "cannot be read as a video")], ids=["empty", "text"]
)
def test_a_broken_video_is_one_line_and_leaves_nothing(tmp_path: Path, content: bytes, words: str) -> None:
    film = tmp_path / "film.mp4"
    film.write_bytes(content)
    for command in ("run", "inspect"):
        options = ["--out", str(tmp_path / "out")] if command == "run" else []
        result = CliRunner().invoke(cli, [command, str(film), *options])
        assert result.exit_code == 1
        assert result.stderr.splitlines()[-1].startswith(f"error: {film}: {words}; copy it again, or convert it")
    assert not (tmp_path / "out").exists()


def test_a_video_that_is_cut_off_is_told(tmp_path: Path, taken: Callable) -> None:
    film = write_film(tmp_path / "film.avi")
    content = film.read_bytes()
    film.write_bytes(content[: len(content) // 2])
    stated = read_video_header(film).frames
    _, events = taken(film)
    assert f"of {stated} frames, so it may be damaged" in events[-1].text


def test_what_is_no_video_is_told(tmp_path: Path, taken: Callable) -> None:
    (tmp_path / "notes.txt").write_text("x")
    with pytest.raises(FormatError, match=r"notes\.txt: is neither a capture folder nor a video"):
        taken(tmp_path / "notes.txt")


def test_the_command_takes_a_video_and_says_so(tmp_path: Path) -> None:
    film = write_film(tmp_path / "wall.mp4")
    settings = ["--set", "ingest.video_frames=2", "--set", "calibrate.time_limit=0.0001"]
    result = CliRunner().invoke(cli, ["run", str(film), "--out", str(tmp_path / "out"), *settings])
    assert f"{film}: a video: pipeline photos" in result.stderr
    assert "wall.mp4: 2 of 40 frames are taken" in result.stderr
    assert len(os.listdir(tmp_path / "out/stills/wall/images")) == 2


def test_inspect_tells_the_length_of_a_video(tmp_path: Path) -> None:
    film = write_film(tmp_path / "wall.mp4")
    result = CliRunner().invoke(cli, ["inspect", str(film), "--json"])
    assert '"kind": "video"' in result.stdout
    assert '"frames": 40' in result.stdout
    assert '"seconds": 1.6' in result.stdout
