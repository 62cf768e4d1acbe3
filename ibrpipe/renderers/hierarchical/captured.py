"""Captured things of a scene: assets, textures and relief meshes, drawn by the renderers that know them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ibrpipe.errors import RendererError
from ibrpipe.renderers.api import Prepared, prepare, render
from ibrpipe.renderers.composite import composite
from ibrpipe.renderers.registry import find_renderer
from ibrpipe.types import Array, Asset, Camera, Frame, Part, Scene
from ibrpipe.types.relief_mesh import ReliefMesh
from ibrpipe.types.renderable import Captured, enclosing_points
from ibrpipe.types.scene import Bounds

#: how far a matrix may be from a turn and one scale
_SLACK = 1e-6


@dataclass(frozen=True, eq=False)
class CapturedThing:
    """What one part holds for one renderer, and where its copies stand.

    Attributes
    ----------
    renderer : str
    prepared : Prepared
    bounds : Bounds
    matrices : (N, 4, 4) float64
        World from the part: turns, one scale, moves.
    """

    renderer: str
    prepared: Prepared
    bounds: Bounds
    matrices: Array


def captured_things(scene: Scene, wanted: str = "ldi") -> tuple[CapturedThing, ...]:
    """Prepare all captured things of a scene for the renderer `wanted`, what it does not take for `relief` or `ldi`.

    Raises
    ------
    RendererError
        A copy is mirrored, sheared or stretched: photos show a thing as it is.
    """
    found = []
    for name, matrices in _placed(scene).items():
        for renderer, sources in _by_renderer(scene.parts[name], wanted).items():
            points = np.concatenate([enclosing_points(source) for source in sources])
            if len(points) and len(matrices):
                _check(name, matrices)
                bounds = Bounds(points.min(axis=0), points.max(axis=0))
                found.append(CapturedThing(renderer, prepare(sources, renderer), bounds, matrices))
    return tuple(found)


def captured_frame(things: tuple[CapturedThing, ...], camera: Camera, threads: int = 0) -> Frame | None:
    """Draw all that is in view, several rays where edges are; None where there is nothing."""
    frames = captured_frames(things, camera, {}, {"samples": "adaptive", "threads": threads})
    return composite(frames) if frames else None


def captured_frames(
    things: Sequence[CapturedThing], camera: Camera, options: Mapping[str, Mapping[str, Any]], usual: Mapping[str, Any]
) -> list[Frame]:
    """Draw every copy that is in view; `options` by renderer, `usual` those of renderers that it does not name."""
    return [
        _drawn(thing, matrix, camera, options.get(thing.renderer, usual))
        for thing in things
        for matrix in thing.matrices
        if _in_view(thing.bounds, matrix, camera)
    ]


def _drawn(thing: CapturedThing, matrix: Array, camera: Camera, options: Mapping[str, Any]) -> Frame:
    """Draw one copy: the camera is brought to the part's coordinates, depth back to the world's."""
    scale = float(np.cbrt(np.linalg.det(matrix[:3, :3])))
    moved = camera.R @ matrix[:3, 3] + camera.cam_from_world[:, 3]
    pose = np.concatenate([camera.R @ matrix[:3, :3], moved[:, None]], axis=1) / scale
    inner = Camera(camera.K, pose, camera.width, camera.height)
    frame = render(thing.prepared, inner, thing.renderer, **_with_light(options, matrix))
    assert frame.depth is not None
    return Frame(frame.color, frame.depth * np.float32(scale), frame.alpha, frame.stats)


def _with_light(options: Mapping[str, Any], matrix: Array) -> dict[str, Any]:
    """Options with the lamp, if there is one, in a part's coordinates."""
    found = dict(options)
    if found.get("light") is not None:
        lamp = np.array([*found["light"], 1.0][:4])  # 0 at the end: a direction
        found["light"] = (np.linalg.inv(matrix) @ lamp).tolist()[: len(found["light"])]
    return found


def _placed(scene: Scene) -> dict[str, Array]:
    """World matrices (N, 4, 4) of all copies of parts that hold captured things."""
    leads: set[str] = set()
    for name, part in scene.parts.items():  # children stand before parents
        if part.sources or any(copies.part in leads for copies in part.children):
            leads.add(name)
    placed: dict[str, list[Array]] = {name: [] for name in leads}
    if scene.root in leads:
        placed[scene.root].append(np.eye(4)[None])
    for name in reversed(list(scene.parts)):
        if name not in leads or not placed[name]:
            continue
        here = np.concatenate(placed[name])
        for copies in scene.parts[name].children:
            if copies.part in leads:
                placed[copies.part].append(np.einsum("nij,mjk->nmik", here, copies.matrices).reshape(-1, 4, 4))
    return {name: np.concatenate(found) for name, found in placed.items() if found and scene.parts[name].sources}


def _by_renderer(part: Part, wanted: str) -> dict[str, list[Captured]]:
    taken, found = find_renderer(wanted).accepts, dict[str, list[Captured]]()
    for source in part.sources:
        for each in source.textures if isinstance(source, Asset) else (source,):
            other = "relief" if isinstance(each, ReliefMesh) else "ldi"
            found.setdefault(wanted if isinstance(each, taken) else other, []).append(each)
    return found


def _check(name: str, matrices: Array) -> None:
    turns = matrices[:, :3, :3]
    squares = np.linalg.norm(turns, axis=(1, 2)) ** 2 / 3
    products = np.einsum("nji,njk->nik", turns, turns) / np.where(squares > 0, squares, 1.0)[:, None, None]
    off = np.abs(products - np.eye(3)).max(axis=(1, 2))
    bad = (off > _SLACK) | (np.linalg.det(turns) <= 0)
    if bad.any():
        raise RendererError(
            f"copy {int(bad.argmax())} of {name!r} is mirrored, sheared, stretched or flattened, and holds captured "
            "things, which are drawn as they were photographed; place it by turns, moves and one scale"
        )


def _in_view(bounds: Bounds, matrix: Array, camera: Camera) -> bool:
    """Whether the box around a copy may show: no side of the view's pyramid has all of it beyond."""
    corners = np.stack(np.meshgrid(*zip(bounds.low, bounds.high), indexing="ij"), axis=-1).reshape(8, 3)
    world = corners @ matrix[:3, :3].T + matrix[:3, 3]
    local = world @ camera.R.T + camera.cam_from_world[:, 3]
    x, y, w = (local @ camera.K.T).T
    beyond = (w <= 0, x < 0, x > camera.width * w, y < 0, y > camera.height * w)
    return not any(side.all() for side in beyond)
