"""Scenes for renderers that know none: they draw what was captured, `hierarchical` the meshes, joined by depth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from time import perf_counter
from typing import Any

import numpy as np

from ibrpipe.errors import RendererError
from ibrpipe.renderers.api import Prepared, prepare, render
from ibrpipe.renderers.composite import composite
from ibrpipe.renderers.frames import make_frame
from ibrpipe.renderers.hierarchical.captured import CapturedThing, captured_frames, captured_things
from ibrpipe.types import Camera, Frame, Part, Scene
from ibrpipe.types.prerendered import PrerenderedScene

#: what compositing needs of every frame
_ALL = ("color", "depth", "alpha")


@dataclass(frozen=True, eq=False)
class JoinedScene:
    """A scene laid out for one renderer.

    Attributes
    ----------
    renderer : str
    things : tuple of CapturedThing
        What was captured, for `renderer`; what it does not take, for another one.
    meshes : Prepared or None
        All meshes, for `hierarchical`; None where there are none.
    """

    renderer: str
    things: tuple[CapturedThing, ...]
    meshes: Prepared | None

    @property
    def bytes(self) -> int:
        """Bytes held beyond the scene."""
        return sum(each.prepared.bytes for each in self.things) + (self.meshes.bytes if self.meshes else 0)

    def draw(self, camera: Camera, outputs: Sequence[str], options: Mapping[str, Any]) -> Frame:
        """Draw one frame; `options` are those of the renderer."""
        began = perf_counter()
        shared = {name: options[name] for name in ("samples", "threads") if name in options}
        frames = captured_frames(self.things, camera, {self.renderer: options}, shared)
        if self.meshes is not None:
            frames.append(render(self.meshes, camera, "hierarchical", _ALL, **shared))
        stats = {"frames": len(frames), "milliseconds": 1e3 * (perf_counter() - began)}
        if not frames:
            return _empty(camera, outputs, stats)
        frame = composite(frames)
        return make_frame(outputs, frame.depth, frame.color, frame.alpha, stats)


def join_scene(source: Scene | PrerenderedScene, renderer: str) -> JoinedScene:
    """Lay a scene out for a renderer that knows no scenes.

    Raises
    ------
    RendererError
        Nothing in it was captured, or it stands mirrored, sheared or stretched.
    """
    scene = source.scene if isinstance(source, PrerenderedScene) else source
    things = captured_things(scene, renderer)
    if not things:
        raise RendererError(
            f"renderer {renderer!r} cannot take a Scene of meshes alone: it holds no assets, relief textures or relief "
            "meshes; choose renderer 'hierarchical'"
        )
    bare = Scene(
        [Part(part.name, part.meshes, (), part.children) for part in scene.parts.values()], scene.root, scene.lighting
    )
    if not bare.polygons[bare.root]:
        return JoinedScene(renderer, things, None)
    meshes = bare if source is scene else PrerenderedScene(bare, source.library)  # type: ignore[union-attr]
    return JoinedScene(renderer, things, prepare(meshes, "hierarchical"))


def _empty(camera: Camera, outputs: Sequence[str], stats: dict[str, Any]) -> Frame:
    size = (camera.height, camera.width)
    nothing = np.zeros(size, np.float32)
    return make_frame(outputs, np.full(size, np.inf, np.float32), np.zeros((*size, 3), np.float32), nothing, stats)
