"""Stage render: an asset and a camera path in, frames out: OpenEXR (linear RGBA and depth), PNG, optional video."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from time import perf_counter
from typing import Any, Literal

from pydantic import Field, field_validator, model_validator

from ibrpipe.config import StageConfig
from ibrpipe.engine.stage import Stage, StageOutputs, artifact
from ibrpipe.errors import ConfigError, ShapeError
from ibrpipe.io.assets import read_asset
from ibrpipe.io.documents.frames import Frames, RenderedFrame
from ibrpipe.io.frames import frame_entry, write_frame, write_frames
from ibrpipe.io.paths import OWN_PATHS, CameraPath, camera_path, is_orbit, orbit, parse_orbit, read_path
from ibrpipe.io.videos.write import write_video
from ibrpipe.io.views import ViewSet, read_views
from ibrpipe.picture_files import write_png
from ibrpipe.progress import track
from ibrpipe.renderers.api import Prepared, prepare, render
from ibrpipe.renderers.registry import shows_view_dependence
from ibrpipe.renderers.renderer_spec import Choice, choose, with_samples
from ibrpipe.types import Array, Asset, Camera, Part, Scene
from ibrpipe.types.prerendered import PrerenderedScene
from ibrpipe.types.relief_mesh import ReliefMesh

#: what the command line tells when the stage is done
SUMMARY = "summary.txt"
Output = Literal["color", "depth", "alpha"]


class RenderConfig(StageConfig):
    """Settings of the render stage."""

    renderers: tuple[str, ...] = Field(
        default=("ldi",),
        min_length=1,
        description="Renderers to use, by name, with options if need be, such as epipolar:search=nearest; "
        "`ibrpipe schema renderer_NAME` prints those of one",
    )
    path: str = Field(
        default="test",
        min_length=1,
        description="Camera path: test (held-out views; without any, some of the photos), train, all, a COLMAP model "
        "folder, a transforms.json, or orbit:key=value,...",
    )
    outputs: tuple[Output, ...] = Field(
        default=("color", "depth", "alpha"), min_length=1, description="What frames hold: color, depth, alpha"
    )
    width: int | None = Field(
        default=None, ge=1, le=65536, description="Width of the frames in pixels; none = as the path"
    )
    height: int | None = Field(
        default=None, ge=1, le=65536, description="Height in pixels; none = follows from the width"
    )
    residuals: bool = Field(default=True, description="Add the view-dependent residuals")
    samples: Literal[1, 4, 9, 16, 64, "adaptive"] = Field(
        default="adaptive", description="Rays of a pixel; adaptive = one, and several where a pixel shows an edge"
    )
    progressive: bool = Field(
        default=False, description="Renderer ldi: write the picture without residuals first, as VIEW_first.png"
    )
    repeats: int = Field(default=3, ge=1, le=1000, description="Times every frame is rendered; the median time counts")
    video: bool = Field(default=False, description="Also write the frames as MP4: H.264 with the extra av, else VP9")
    fps: float = Field(default=24.0, gt=0, le=1000, description="Frames per second of the video")

    @field_validator("path")
    @classmethod
    def _path_is_sound(cls, path: str) -> str:
        if is_orbit(path):
            parse_orbit(path)
        elif path not in OWN_PATHS and not Path(path).exists():  # told before a run has spent minutes
            raise ValueError(f"there is no such camera path; give {', '.join(OWN_PATHS)}, orbit, a folder or a file")
        return path

    @field_validator("renderers")
    @classmethod
    def _options_are_sound(cls, names: tuple[str, ...]) -> tuple[str, ...]:
        for name in names:
            if ":" in name:
                choose(name)
        return names

    @model_validator(mode="after")
    def _progress_is_known(self) -> RenderConfig:
        other = [text for text in self.renderers if choose(text).name != "ldi"] if self.progressive else []
        if other or (self.progressive and "color" not in self.outputs):
            told = f"not with {other[0]}" if other else "and only with outputs that hold color"
            raise ValueError(f"progressive: pictures come one after another with renderer ldi, {told}")
        return self

    @field_validator("renderers", "outputs")
    @classmethod
    def _named_once(cls, names: tuple[str, ...]) -> tuple[str, ...]:
        if len(set(names)) < len(names):
            raise ValueError(f"names one thing twice: {', '.join(names)}")
        return names


@dataclass(frozen=True)
class Inputs:
    """An asset folder, the views it was made from (none: an asset without a capture), and the folder to write to."""

    asset: Path
    views: Path | None = None
    out: Path = Path()


@dataclass(frozen=True)
class Outputs(StageOutputs):
    """What render writes: a list of frames, and the frames themselves in one folder per renderer."""

    frames: Path = artifact("", "Folder of the render stage.")
    frames_document: Path = artifact("frames.json", "List of the frames.", Frames)


def run(inputs: Inputs, config: RenderConfig) -> Outputs:
    """Render an asset along a camera path with every renderer asked for.

    Raises
    ------
    RendererError
        A renderer is unknown or cannot render the asset.
    ConfigError, MissingFileError
        The camera path does not exist or is empty.
    """
    asset = read_asset(inputs.asset)
    views = read_views(inputs.views) if inputs.views else ViewSet((), ())
    path = camera_path(config.path, asset, views)
    outputs = _render_with_all(asset, path, inputs.out, config)
    if config.path == "test" and views.train and not views.test:
        text = f"no photo is held out: the frames show {len(path)} of the {len(views.train)} photos' own views"
        with (inputs.out / SUMMARY).open("a", encoding="utf-8") as summary:
            summary.write(text + "\n")
    return outputs


def render_scene(source: Scene | PrerenderedScene, out: Path, config: RenderConfig) -> Outputs:
    """Render a scene along an orbit or the cameras of a file; as `run` else.

    An orbit goes round what the scene's root holds copies of, not round its own meshes (ground), if it holds any.
    """
    scene = source.scene if isinstance(source, PrerenderedScene) else source
    if is_orbit(config.path):
        path = orbit(parse_orbit(config.path), _shown_bounds(scene))
    elif config.path in OWN_PATHS:
        raise ConfigError(f"a scene has no photos, so no path {config.path!r}; give orbit, a folder or a file")
    else:
        path = read_path(Path(config.path))
    return _render_with_all(source, path, out, config)


def _shown_bounds(scene: Scene) -> tuple[Array, Array]:
    root = scene.parts[scene.root]
    inner = Part(root.name, (), root.sources, root.children)
    bounds = Scene([*(part for part in scene.parts.values() if part is not root), inner], root.name).bounds[root.name]
    bounds = scene.bounds[scene.root] if bounds.empty else bounds
    if bounds.empty:
        raise ConfigError("the scene is empty, so there is nothing to look at; give its parts meshes")
    return bounds.low, bounds.high


def _render_with_all(
    source: Asset | Scene | PrerenderedScene, path: CameraPath, out: Path, config: RenderConfig
) -> Outputs:
    """Render a path with every renderer asked for; write frames, their list and videos."""
    path = tuple((name, _sized(camera, config.width, config.height)) for name, camera in path)
    frames: list[RenderedFrame] = []
    videos: dict[str, str] = {}
    told: list[str] = []
    for renderer in config.renderers:
        choice = choose(renderer)
        folder = out / choice.folder
        folder.mkdir(parents=True, exist_ok=True)
        frames += _render_all(source, path, choice, folder, config)
        if config.video and "color" in config.outputs:
            videos[renderer] = f"{choice.folder}/{choice.folder}.mp4"
            pictures = [out / frame.png for frame in frames if frame.renderer == renderer and frame.png]
            told.append(write_video(out / videos[renderer], pictures, config.fps))
    outputs = Outputs.below(out)
    document = Frames(
        path=config.path, renderers=list(config.renderers), samples=config.samples, videos=videos, frames=frames
    )
    write_frames(outputs.frames_document, document)
    if any(told):
        (out / SUMMARY).write_text("\n".join(filter(None, told)) + "\n", encoding="utf-8")
    return outputs


def _sized(camera: Camera, width: int | None, height: int | None) -> Camera:
    """Resize a camera; one side alone keeps the shape."""
    if width is None and height is None:
        return camera
    wide = width or max(1, round(camera.width * (height or 1) / camera.height))
    return camera.resized(wide, height or max(1, round(camera.height * wide / camera.width)))


def _render_all(
    source: Asset | Scene | PrerenderedScene, path: CameraPath, choice: Choice, folder: Path, config: RenderConfig
) -> list[RenderedFrame]:
    """Render and write all frames of one renderer; return their entries of frames.json."""
    renderer = choice.name
    prepared = prepare(source, renderer)
    options = ({"residuals": config.residuals} if shows_view_dependence(renderer) else {}) | dict(
        with_samples(choice, config.samples).options
    )
    render(prepared, path[0][1].resized(8, 8), renderer, config.outputs, **options)  # compiles, outside the timer
    entries = []
    for name, camera in track(path, f"render {choice.text}"):
        if config.progressive:
            entries.append(_progressive(prepared, name, camera, choice, folder, config, options))
            continue
        milliseconds = []
        for _ in range(config.repeats):
            began = perf_counter()
            frame = render(prepared, camera, renderer, config.outputs, **options)
            milliseconds.append(1e3 * (perf_counter() - began))
        files = write_frame(frame, folder / name)
        entries.append(frame_entry(name, choice.text, camera, frame, files, median(milliseconds)))
    return entries


def _progressive(
    prepared: Prepared, name: str, camera: Camera, choice: Choice, folder: Path, config: RenderConfig, options: Any
) -> RenderedFrame:
    """Render one view: its first picture is on the disk before the next is begun. Times are those of rendering."""
    from ibrpipe.renderers.ldi.progressive import render_progressive

    times: list[tuple[float, float]] = []
    for repeat in range(config.repeats):
        first, spent, began = None, 0.0, perf_counter()
        for frame in render_progressive(prepared, camera, config.outputs, **options):
            spent += 1e3 * (perf_counter() - began)
            first = spent if first is None else first
            if repeat == 0 and first == spent and frame.color is not None:
                write_png(folder / f"{name}_first.png", frame.color, frame.alpha)
            began = perf_counter()
        times.append((first or 0.0, spent))
    first_ms, whole_ms = (median(each) for each in zip(*times, strict=True))
    entry = frame_entry(name, choice.text, camera, frame, write_frame(frame, folder / name), whole_ms)
    return entry.model_copy(update={"first": f"{folder.name}/{name}_first.png", "first_ms": round(first_ms, 4)})


STAGE = Stage(
    name="render",
    summary="Render an asset along a camera path to OpenEXR, PNG and, if asked for, video.",
    inputs=Inputs,
    outputs=Outputs,
    config=RenderConfig,
    run=run,
    example="ibrpipe render --out runs/vase --path orbit:frames=96,elevation=25 --video",
)


def render_path(
    sources: Sequence[ReliefMesh],
    path: CameraPath,
    out: Path,
    options: Mapping[str, Any],
    repeats: int = 1,
    moved: Sequence[Array] = (),
) -> list[RenderedFrame]:
    """Render relief-mapped meshes along a path -> entries of ``frames.json``, which is written beside the frames.

    `moved`: vertices (V, 3) of the one mesh for every frame; a path of one view is then seen from all the time.
    """
    out.mkdir(parents=True, exist_ok=True)
    prepared, frames = prepare(list(sources), "relief"), list(path)
    if moved and len(frames) == 1:
        frames = [(f"{frames[0][0]}_{k:04d}", frames[0][1]) for k in range(len(moved))]
    if moved and len(moved) != len(frames):
        raise ShapeError(f"there are {len(moved)} moved meshes for {len(frames)} views; give one for each, or one view")
    render(prepared, frames[0][1].resized(8, 8), "relief", **options)  # compiles, outside the timer
    entries = []
    for number, (name, camera) in enumerate(frames):
        more = {**options, "vertices": moved[number]} if moved else options
        milliseconds = []
        for _ in range(repeats):
            began = perf_counter()
            frame = render(prepared, camera, "relief", **more)
            milliseconds.append(1e3 * (perf_counter() - began))
        files = write_frame(frame, out / name)
        entries.append(frame_entry(name, "relief", camera, frame, files, median(milliseconds)))
    plain = {key: _plain(value) for key, value in options.items()}
    write_frames(out / "frames.json", Frames(renderers=["relief"], options=plain, frames=entries))
    return entries


def _plain(value: Any) -> Any:
    return list(value) if isinstance(value, tuple) else value
