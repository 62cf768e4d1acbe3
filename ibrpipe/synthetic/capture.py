"""Synthetic captures: photos, masks, cameras, mesh and exact truth in the layout of a real capture folder."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np
from pydantic import Field

from ibrpipe.config import StageConfig
from ibrpipe.core.color import srgb_decode, srgb_encode
from ibrpipe.errors import ConfigError
from ibrpipe.io.photos.images import write_exr, write_png
from ibrpipe.io.surfaces.meshes import write_mesh
from ibrpipe.progress import track
from ibrpipe.synthetic.layout import write_colmap_text, write_transforms
from ibrpipe.synthetic.photograph import Photo, Truth, measure_truth, take_photo
from ibrpipe.synthetic.rig import cameras_around, jittered, photo_directions, test_directions
from ibrpipe.synthetic.scene import Scene, StagedScene, prepare_scene
from ibrpipe.synthetic.scenes import make_scene
from ibrpipe.synthetic.surfaces import Winding, wound
from ibrpipe.types import Array, Camera
from ibrpipe.version import VERSION

T = TypeVar("T")


class SynthConfig(StageConfig):
    """Size and quality of a synthetic capture."""

    photos: int = Field(default=48, ge=2, le=2000, description="Number of photos")
    tests: int = Field(default=8, ge=0, le=500, description="Number of held-out views with truth")
    width: int = Field(default=320, ge=8, le=8192, description="Width of a photo in pixels")
    height: int = Field(default=240, ge=8, le=8192, description="Height of a photo in pixels")
    rays: int = Field(default=3, ge=1, le=16, description="Rays per pixel along x and along y")
    detail: float = Field(
        default=1.0, gt=0, le=16, description="Multiplies the mesh's resolution along either direction"
    )
    occlusion_rays: int = Field(
        default=64, ge=0, le=4096, description="Rays per vertex for the occlusion of the sky; 0 = none"
    )
    jitter_deg: float = Field(default=1.0, ge=0, le=20, description="Random displacement of the cameras in degrees")
    noise: float = Field(default=0.0, ge=0, le=64, description="Noise of the photos (not of the tests) in 8-bit steps")
    seed: int = Field(default=0, ge=0, description="Seed of the camera displacement and of the noise")
    cameras: bool = Field(
        default=True, description="State the cameras; without, they go to truth/ and there are no test views"
    )
    mesh: bool = Field(default=True, description="Give the mesh; without, it goes to truth/")
    winding: Winding = Field(
        default="consistent",
        description="How the given mesh winds its faces: counter-clockwise from outside, all the other way round "
        "(inverted), or every other one by chance (mixed)",
    )

    @property
    def measured(self) -> int:
        """Number of test views: a view with truth needs cameras in the truth's world."""
        return self.tests if self.cameras else 0


#: enough for a test of the whole pipeline: made in about a second
TINY = SynthConfig(photos=14, tests=3, width=96, height=72, rays=2, detail=0.35, occlusion_rays=16)


@dataclass(frozen=True, eq=False)
class _Views:
    """Cameras of one half of a capture and the names of their files."""

    names: tuple[str, ...]
    cameras: tuple[Camera, ...]


def write_capture(scene: str | Scene, out: str | os.PathLike[str], config: SynthConfig | None = None) -> Path:
    """Photograph a scene into a new capture folder.

    Parameters
    ----------
    scene : a name of `ibrpipe.synthetic.scenes.scene_names` or a Scene
    out : folder that does not exist yet or is empty
    config : SynthConfig, optional

    Returns
    -------
    Path
        The folder; it appears only when everything in it is complete.

    Raises
    ------
    ConfigError
        The scene is unknown, or `out` holds something.
    """
    config, target = config or SynthConfig(), Path(out)
    if target.exists() and (not target.is_dir() or any(target.iterdir())):
        raise ConfigError(f"{target} exists already and is not an empty folder; choose another name or remove it")
    description = make_scene(scene, config.detail) if isinstance(scene, str) else scene
    part = target.with_name(f".{target.name}.part")
    shutil.rmtree(part, ignore_errors=True)
    part.mkdir(parents=True)
    try:
        _fill(part, description, config)
        if target.exists():
            target.rmdir()
        part.rename(target)
    finally:
        shutil.rmtree(part, ignore_errors=True)
    return target


def plan_views(staged: StagedScene, config: SynthConfig) -> tuple[list[Camera], list[Camera]]:
    """Cameras of the photos and of the tests."""
    rig, mesh = staged.scene.rig, staged.caster.mesh
    random = np.random.default_rng([config.seed, 1])
    directions = photo_directions(rig, config.photos) + test_directions(rig, config.tests)
    directions = jittered(directions, config.jitter_deg, random)
    cameras = cameras_around(mesh, rig, directions, config.width, config.height)
    return cameras[: config.photos], cameras[config.photos :][: config.measured]


def _fill(folder: Path, scene: Scene, config: SynthConfig) -> None:
    """Write everything below `folder`."""
    staged = prepare_scene(scene, config.occlusion_rays)
    truth = folder / "truth"
    if not (config.cameras and config.mesh):
        truth.mkdir()
    given = wound(staged.caster.mesh, config.winding, np.random.default_rng([config.seed, 3]))
    write_mesh(given, (folder if config.mesh else truth) / "mesh.ply")
    photos, tests = plan_views(staged, config)
    _write_cameras(folder if config.cameras else truth, photos, "mesh.ply" if config.mesh else None)
    _make_folders(folder)
    for name, photo in _developed(photos, lambda camera: take_photo(staged, camera, config.rays), "photos"):
        random = np.random.default_rng([config.seed, 2, int(name[:-4])])
        _write_photo(folder, name, _noisy(photo.color, config.noise, random), photo.coverage)
    if tests:
        _write_tests(folder / "test", staged, tests, config)
    text = json.dumps(_described(scene, staged, config), indent=1)
    (folder / "scene.json").write_text(text + "\n", encoding="utf-8")


def _make_folders(folder: Path) -> None:
    """Make the folders of the photos or of the tests."""
    for name in ("images", "masks"):
        (folder / name).mkdir(parents=True)


def _write_cameras(folder: Path, cameras: Sequence[Camera], mesh: str | None) -> None:
    """Write the cameras of the photos or of the tests."""
    names = [_name(index) for index in range(len(cameras))]
    write_colmap_text(folder / "sparse" / "0", names, cameras)
    write_transforms(folder / "transforms.json", names, cameras, mesh)


def _noisy(color: Array, noise: float, random: np.random.Generator) -> Array:
    """Add Gaussian noise of standard deviation `noise`, in 8-bit steps of the coded picture."""
    if noise == 0.0:
        return color
    coded = srgb_encode(color) + noise / 255.0 * random.standard_normal(color.shape)
    return srgb_decode(np.clip(coded, 0.0, 1.0))


def _write_photo(folder: Path, name: str, color: Array, coverage: Array) -> None:
    """Write images/NAME and masks/NAME; the mask's bytes are the coverage itself, not its sRGB code."""
    write_png(folder / "images" / name, color)
    write_png(folder / "masks" / name, srgb_decode(coverage))


def _write_tests(folder: Path, staged: StagedScene, cameras: list[Camera], config: SynthConfig) -> None:
    """Write the held-out views with their truth."""
    _make_folders(folder)
    _write_cameras(folder, cameras, None)
    for name in ("depth", "normals", "diffuse"):
        (folder / name).mkdir()

    def develop(camera: Camera) -> tuple[Photo, Truth]:
        return take_photo(staged, camera, config.rays), measure_truth(staged, camera)

    for name, (photo, truth) in _developed(cameras, develop, "test views"):
        _write_photo(folder, name, photo.color, photo.coverage)
        write_png(folder / "diffuse" / name, photo.diffuse)
        exr = name.replace(".png", ".exr")
        write_exr(folder / "depth" / exr, np.where(np.isinf(truth.depth), np.float32(0), truth.depth))
        write_exr(folder / "normals" / exr, truth.normal)


def _developed(cameras: Sequence[Camera], job: Callable[[Camera], T], label: str) -> Iterator[tuple[str, T]]:
    """Run `job` for all cameras on all cores; yield file name and result in order."""
    with ThreadPoolExecutor(max_workers=os.cpu_count()) as pool:
        results = pool.map(job, cameras)
        for index, result in enumerate(track(results, label, len(cameras))):
            yield _name(index), result


def _name(index: int) -> str:
    return f"{index:03d}.png"


def _described(scene: Scene, staged: StagedScene, config: SynthConfig) -> dict[str, object]:
    """Content of scene.json."""
    return {
        "generator": f"ibrpipe synth {VERSION}",
        "scene": scene.name,
        "summary": scene.summary,
        "seed": config.seed,
        "units": "scene units; world axes right-handed, z up",
        "options": config.model_dump(),
        "rig": asdict(scene.rig),
        "lights": asdict(scene.studio),
        "backdrop": scene.backdrop,
        "parts": [
            {
                "name": part.name,
                "faces": [int(found[0]), int(found[-1]) + 1],
                "material": asdict(part.gloss) if part.gloss else None,
            }
            for index, part in enumerate(scene.parts)
            for found in [np.flatnonzero(staged.part == index)]
        ],
        "encoding": {
            "images": "8-bit sRGB, radiance 1.0 = 255, clipped above; rays x rays evenly spaced rays, box filter",
            "masks": "8-bit coverage, 255 = object; the images' filter",
        },
        "truth": {
            "mesh": f"{'' if config.mesh else 'truth/'}mesh.ply: the very triangles that were photographed, float32",
            "depth": "test/depth/NNN.exr: float32 depth along the camera's z at the pixel centre; 0 = nothing there",
            "normals": "test/normals/NNN.exr: float32 shading normal, world axes, pixel centre; 0 = nothing there",
            "diffuse": "test/diffuse/NNN.png: the test view without the coat's reflections, 8-bit sRGB",
            "shading": "albedo(p) * irradiance(n) * openness + fresnel(n.v) * (sky(r) + glints(r)) * openness",
        },
    }
