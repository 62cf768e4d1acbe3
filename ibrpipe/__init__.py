"""Photographs in, view-dependent image-based 3-D assets out, rendered on an ordinary CPU, with the error measured."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ibrpipe.errors import IbrError
from ibrpipe.version import VERSION as __version__

if TYPE_CHECKING:
    from ibrpipe.io.assets import read_asset, read_textures, write_asset
    from ibrpipe.io.captures import read_capture
    from ibrpipe.io.scenes import read_scene, write_scene
    from ibrpipe.io.surfaces.materials import read_relief_mesh, read_relief_meshes
    from ibrpipe.io.surfaces.reliefs import read_reliefs, write_reliefs
    from ibrpipe.renderers.api import Prepared, prepare, render, renderers
    from ibrpipe.renderers.composite import composite
    from ibrpipe.renderers.hierarchical.forms import prerender
    from ibrpipe.renderers.ldi.progressive import render_progressive
    from ibrpipe.renderers.orbits import orbit
    from ibrpipe.renderers.prewarp.prewarped import prewarp
    from ibrpipe.stages.whole_run import FinishedRun, run
    from ibrpipe.types import (
        Asset,
        Camera,
        DepthImage,
        Frame,
        Instances,
        LayeredDepthImage,
        Light,
        Lighting,
        Mesh,
        PaintedMesh,
        ParallelFrame,
        Part,
        ReliefTexture,
        Scene,
        SpiralResiduals,
        SpiralTexture,
        Texture,
        ViewDependence,
    )
    from ibrpipe.types.relief_mesh import ReliefMesh

_HOME = {
    "Asset": "types",
    "Camera": "types",
    "DepthImage": "types",
    "FinishedRun": "stages.whole_run",
    "Frame": "types",
    "Instances": "types",
    "LayeredDepthImage": "types",
    "Light": "types",
    "Lighting": "types",
    "Mesh": "types",
    "PaintedMesh": "types",
    "ParallelFrame": "types",
    "Part": "types",
    "ReliefMesh": "types.relief_mesh",
    "ReliefTexture": "types",
    "Scene": "types",
    "SpiralResiduals": "types",
    "SpiralTexture": "types",
    "Texture": "types",
    "ViewDependence": "types",
    "Prepared": "renderers.api",
    "composite": "renderers.composite",
    "orbit": "renderers.orbits",
    "prepare": "renderers.api",
    "prerender": "renderers.hierarchical.forms",
    "prewarp": "renderers.prewarp.prewarped",
    "read_asset": "io.assets",
    "read_capture": "io.captures",
    "read_relief_mesh": "io.surfaces.materials",
    "read_relief_meshes": "io.surfaces.materials",
    "read_reliefs": "io.surfaces.reliefs",
    "read_scene": "io.scenes",
    "read_textures": "io.assets",
    "render": "renderers.api",
    "render_progressive": "renderers.ldi.progressive",
    "run": "stages.whole_run",
    "write_asset": "io.assets",
    "write_reliefs": "io.surfaces.reliefs",
    "write_scene": "io.scenes",
}

__all__ = [
    "Asset",
    "Camera",
    "DepthImage",
    "FinishedRun",
    "Frame",
    "IbrError",
    "Instances",
    "LayeredDepthImage",
    "Light",
    "Lighting",
    "Mesh",
    "PaintedMesh",
    "ParallelFrame",
    "Part",
    "Prepared",
    "ReliefMesh",
    "ReliefTexture",
    "Scene",
    "SpiralResiduals",
    "SpiralTexture",
    "Texture",
    "ViewDependence",
    "__version__",
    "composite",
    "export",
    "orbit",
    "prepare",
    "prerender",
    "prewarp",
    "read_asset",
    "read_capture",
    "read_relief_mesh",
    "read_relief_meshes",
    "read_reliefs",
    "read_scene",
    "read_textures",
    "render",
    "render_progressive",
    "renderers",
    "run",
    "write_asset",
    "write_reliefs",
    "write_scene",
]


def __getattr__(name: str) -> Any:
    """Import a public name on first use, so that ``import ibrpipe`` and ``ibrpipe --help`` stay instant."""
    from importlib import import_module

    if name in ("export", "renderers"):  # packages that can be called
        return import_module(f"ibrpipe.{name}")
    if name not in _HOME:
        raise AttributeError(f"module 'ibrpipe' has no attribute {name!r}")
    value = getattr(import_module(f"ibrpipe.{_HOME[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
