"""The render stage on a hand-made asset: files, timings, paths, sizes, video."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from ibrpipe.cli.main import cli
from ibrpipe.errors import ConfigError, IbrError
from ibrpipe.io.assets import write_asset
from ibrpipe.io.paths import frames_folder
from ibrpipe.io.photos.images import read_depth, read_image
from ibrpipe.io.views import View, ViewSet, write_views
from ibrpipe.renderers.renderer_spec import choose
from ibrpipe.stages.render import STAGE, Inputs, RenderConfig, run
from ibrpipe.types import Asset, Camera, LayeredDepthImage, ParallelFrame, SpiralTexture

HEIGHT, WIDTH, TEXEL = 20, 24, 0.1
COLOR = (0.25, 0.5, 0.125)  # half floats hold them exactly


def wall() -> Asset:
    """A plane z = 1 of one colour, 2.4 x 2 units around the z axis, facing -z."""
    frame = ParallelFrame((-1.2, -1.0, 0.0), (TEXEL, 0, 0), (0, TEXEL, 0), (0, 0, 1))
    offsets = np.arange(HEIGHT)[:, None] * WIDTH + np.arange(WIDTH + 1)
    count = HEIGHT * WIDTH
    color = np.tile(np.array(COLOR, np.float32), (count, 1))
    normal = np.tile(np.array([0, 0, -1], np.float32), (count, 1))
    return Asset((SpiralTexture(LayeredDepthImage(frame, offsets, np.ones(count), color, normal)),))


def camera(x: float) -> Camera:
    return Camera.look_at((x, 0, -3), (x, 0, 1), up=(0, -1, 0), fov_y_deg=50, width=32, height=24)


@pytest.fixture
def inputs(tmp_path: Path) -> Inputs:
    write_asset(wall(), tmp_path / "asset")
    train = tuple(View(f"train{i}", camera(0.1 * i), tmp_path / f"{i}.png") for i in range(3))
    test = (View("held", camera(0.05), tmp_path / "held.png", held_out=True),)
    write_views(ViewSet(train, test), tmp_path / "views.json")
    (tmp_path / "out").mkdir()
    return Inputs(tmp_path / "asset", tmp_path / "views.json", tmp_path / "out")


def frames_of(inputs: Inputs, **settings: object) -> dict:
    outputs = run(inputs, RenderConfig(**settings))
    return json.loads(outputs.frames_document.read_text(encoding="utf-8"))


def test_a_frame_holds_the_walls_depth_and_colour(inputs: Inputs) -> None:
    (entry,) = frames_of(inputs, samples=1)["frames"]
    assert entry["view"] == "held"
    assert entry["renderer"] == "ldi"
    depth, picture = read_depth(inputs.out / entry["file"]), read_image(inputs.out / entry["file"])
    inside = np.isfinite(depth)
    # the wall spans 2.4 x 2 units at depth 4; a pixel there is 2 * 4 * tan(25 degrees) / 24 units
    pixel = 2 * 4 * np.tan(np.radians(25)) / 24
    assert inside.sum() == pytest.approx(2.4 * 2.0 / pixel**2, abs=2 * (32 + 24))
    assert inside.sum() < 32 * 24 * 0.9
    np.testing.assert_allclose(depth[inside], 4.0, rtol=1e-6)
    np.testing.assert_allclose(picture[inside][:, :3], np.tile(COLOR, (inside.sum(), 1)), rtol=1e-5)
    np.testing.assert_array_equal(picture[..., 3], inside)
    coded = read_image(inputs.out / entry["png"])
    assert coded.shape == (24, 32, 4)
    assert np.abs(coded[inside][:, :3] - COLOR).max() < 0.01


def test_the_list_of_frames_says_what_was_done(inputs: Inputs) -> None:
    listed = frames_of(inputs, path="train", repeats=2)
    assert [entry["view"] for entry in listed["frames"]] == ["train0", "train1", "train2"]
    assert listed["path"] == "train"
    assert listed["renderers"] == ["ldi"]
    for index, entry in enumerate(listed["frames"]):
        assert entry["ms"] > 0
        assert entry["stats"]["edge_pixels"] > 0
        assert entry["stats"]["rays"] == 32 * 24 + 9 * entry["stats"]["edge_pixels"]
        assert (inputs.out / entry["file"]).is_file()
        assert (inputs.out / entry["png"]).is_file()
        np.testing.assert_allclose(entry["cam_from_world"], camera(0.1 * index).cam_from_world, atol=1e-12)
    assert not list(inputs.out.rglob(".*"))


def test_pixels_are_the_same_every_time(inputs: Inputs) -> None:
    (entry,) = frames_of(inputs)["frames"]
    files = [inputs.out / entry["file"], inputs.out / entry["png"]]
    before = [file.read_bytes() for file in files]
    frames_of(inputs, repeats=1)
    assert [file.read_bytes() for file in files] == before


@pytest.mark.parametrize(
    ("settings", "size"),
    [({"width": 64}, (64, 48)), ({"height": 12}, (16, 12)), ({"width": 20, "height": 20}, (20, 20))],
)
def test_size_can_be_chosen(inputs: Inputs, settings: dict, size: tuple[int, int]) -> None:
    (entry,) = frames_of(inputs, **settings)["frames"]
    assert (entry["width"], entry["height"]) == size
    assert read_depth(inputs.out / entry["file"]).shape == size[::-1]


def test_only_depth_may_be_asked_for(inputs: Inputs) -> None:
    (entry,) = frames_of(inputs, outputs=("depth",))["frames"]
    assert "png" not in entry
    assert sorted(path.name for path in inputs.out.rglob("*.*")) == ["frames.json", "held.exr"]
    assert np.isfinite(read_depth(inputs.out / entry["file"])).any()


def test_an_orbit_keeps_its_distance(inputs: Inputs) -> None:
    spec = "orbit:frames=4,elevation=30,distance=5,width=16,height=12,up=-y"
    listed = frames_of(inputs, path=spec)
    assert [entry["view"] for entry in listed["frames"]] == [f"orbit_{i:04d}" for i in range(4)]
    for entry in listed["frames"]:
        pose = np.array(entry["cam_from_world"])
        # the middle of the samples is (0, 0, 1) and lies straight ahead
        np.testing.assert_allclose(pose @ [0, 0, 1, 1], [0, 0, 5], atol=1e-9)
    hits = [entry["stats"]["hits"] for entry in listed["frames"]]
    assert hits[0] > 0  # azimuth 0 faces the side where the photos are
    assert max(hits) == hits[0]


def test_edges_are_smooth_unless_one_ray_is_asked_for(inputs: Inputs) -> None:
    """Colours in OpenEXR are multiplied by alpha; read back, they are the wall's at its edge, too."""
    listed = frames_of(inputs)
    (entry,) = listed["frames"]
    assert listed["samples"] == "adaptive"
    picture = read_image(inputs.out / entry["file"])
    alpha = picture[..., 3]
    pixel = 2 * 4 * np.tan(np.radians(25)) / 24
    border = 2 * (2.4 + 2.0) / pixel  # each pixel of it is right to half the distance of its rays
    assert alpha.sum() == pytest.approx(2.4 * 2.0 / pixel**2, abs=border / 6)
    assert ((alpha > 0) & (alpha < 1)).sum() > 20
    np.testing.assert_allclose(picture[alpha > 0][:, :3], np.tile(COLOR, ((alpha > 0).sum(), 1)), rtol=1e-5)
    np.testing.assert_array_equal(alpha[np.isfinite(read_depth(inputs.out / entry["file"]))] > 0.2, True)


def test_the_video_holds_every_frame(inputs: Inputs) -> None:
    import cv2

    listed = frames_of(inputs, path="train", video=True, fps=10)
    video = cv2.VideoCapture(str(inputs.out / listed["videos"]["ldi"]))
    pictures = []
    while (read := video.read())[0]:
        pictures.append(read[1])
    assert len(pictures) == 3
    assert video.get(cv2.CAP_PROP_FPS) == pytest.approx(10)
    still = cv2.imread(str(inputs.out / listed["frames"][1]["png"]), cv2.IMREAD_UNCHANGED)
    still = still[..., :3] * (still[..., 3:] / 255)
    assert np.abs(pictures[1].astype(int) - still).mean() < 6


def test_every_path_has_its_own_folder_and_the_command_says_which(inputs: Inputs, tmp_path: Path) -> None:
    words = ["render", "--asset", inputs.asset, "--views", inputs.views, "--out", tmp_path / "run", "--repeats", "1"]

    def call(*more: str) -> Result:
        return CliRunner().invoke(cli, [str(word) for word in (*words, *more)])

    first, second = call(), call("--path", "orbit:frames=2,width=16,height=12", "--video")
    assert (first.exit_code, second.exit_code) == (0, 0), second.output
    orbit = tmp_path / "run/render-orbit-frames=2,width=16,height=12"
    assert f"{tmp_path / 'run/render/ldi'}: 1 frames of ldi" in first.stdout
    assert f"{orbit / 'ldi'}: 2 frames of ldi" in second.stdout
    assert f"video: {orbit / 'ldi/ldi.mp4'}" in second.stdout
    assert (tmp_path / "run/render/ldi/held.exr").is_file()
    assert (orbit / "ldi/ldi.mp4").is_file()


def test_the_path_of_a_run_keeps_its_folder() -> None:
    assert frames_folder("render", "orbit:frames=9", "orbit:frames=9") == "render"
    assert frames_folder("render", "../other run/sparse/0", "test") == "render-other-run-sparse-0"
    long = [frames_folder("render", f"{'a' * 300}{end}", "test") for end in "bc"]
    assert len({*long}) == 2
    assert max(map(len, long)) < 100


def test_without_held_out_views_some_of_the_photos_are_rendered_and_that_is_told(
    inputs: Inputs, tmp_path: Path
) -> None:
    views = tuple(View(f"p{k:02d}", camera(k % 4), tmp_path / "a.png") for k in range(20))
    write_views(ViewSet(views), tmp_path / "none.json")
    made = run(replace(inputs, views=tmp_path / "none.json"), RenderConfig(repeats=1))
    listed = json.loads(made.frames_document.read_text(encoding="utf-8"))["frames"]
    assert [frame["view"] for frame in listed] == [f"p{k:02d}" for k in (1, 3, 6, 8, 11, 13, 16, 18)]
    assert "no photo is held out: the frames show 8 of the 20" in (made.frames / "summary.txt").read_text()


def test_a_video_that_not_every_phone_plays_is_told(inputs: Inputs, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "av", None)
    listed = frames_of(inputs, video=True, repeats=1)
    assert (inputs.out / listed["videos"]["ldi"]).stat().st_size > 0
    told = (inputs.out / "summary.txt").read_text()
    assert told.endswith("which not every phone plays; for H.264 type: pip install 'ibrpipe[av]'\n")


def test_a_path_without_any_camera_is_told(inputs: Inputs) -> None:
    with pytest.raises(ConfigError, match="'test' has no camera: no photo of the asset is known"):
        run(replace(inputs, views=None), RenderConfig())


@pytest.mark.parametrize(
    ("settings", "match"),
    [
        ({"path": "orbit:frames=0"}, "frames is 0"),
        ({"path": "orbit:speed=3"}, "speed"),
        ({"path": "orbit:up=w"}, "up is w"),
        ({"path": "no/such/path"}, "there is no such camera path; give test, train, all, orbit, a folder or a file"),
        ({"renderers": ()}, "at least 1"),
        ({"renderers": ("ldi", "ldi")}, "twice"),
        ({"repeats": 0}, "greater than or equal to 1"),
        ({"outputs": ("heat",)}, "color"),
        ({"frames": 3}, "[Ee]xtra"),
        ({"renderers": ("splat:footprint",)}, "key=value"),
        ({"renderers": ("splat:size=2",)}, "no option 'size'"),
        ({"renderers": ("magic:size=2",)}, "unknown renderer 'magic'"),
    ],
)
def test_wrong_settings_are_refused(settings: dict, match: str) -> None:
    with pytest.raises(ValueError, match=match):
        RenderConfig(**settings)


def test_a_renderer_that_does_not_exist_is_told(inputs: Inputs) -> None:
    with pytest.raises(IbrError, match="magic"):
        run(inputs, RenderConfig(renderers=("magic",)))


def test_a_path_that_does_not_exist_is_told_before_anything_runs(tmp_path: Path) -> None:
    result = CliRunner().invoke(cli, ["run", "mesh", "--capture", str(tmp_path), "--set", "render.path=no/such"])
    assert result.exit_code == 2
    assert "render.path" in result.output
    assert "there is no such camera path" in result.output


def test_one_renderer_with_different_options_is_two_renderers(inputs: Inputs) -> None:
    listed = frames_of(inputs, renderers=("splat", "splat:footprint=0.3"), path="train")
    assert listed["renderers"] == ["splat", "splat:footprint=0.3"]
    covered = {
        name: [np.isfinite(read_depth(inputs.out / e["file"])).sum() for e in listed["frames"] if e["renderer"] == name]
        for name in listed["renderers"]
    }
    assert min(covered["splat"]) > 2 * max(covered["splat:footprint=0.3"]) > 0
    assert listed["frames"][-1]["file"] == "splat-footprint=0.3/train2.exr"


def test_words_numbers_and_nothing() -> None:
    options = choose("prewarp:method=pipelined,depth_bits=8,max_step=2.5,level=2,quads=auto").options
    assert options == {"method": "pipelined", "depth_bits": 8, "max_step": 2.5, "level": 2, "quads": "auto"}
    assert choose("prewarp:max_step=none").options == {"max_step": None}
    assert choose("ldi:residuals=false").options == {"residuals": False}
    assert choose("ldi").options == {}


def test_the_stage_is_wired() -> None:
    assert STAGE.name == STAGE.folder == "render"
    assert STAGE.config is RenderConfig
