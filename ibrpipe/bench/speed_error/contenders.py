"""Who takes part in ``speed-error``: settings of the registered renderers, and the peers, all called alike."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from time import perf_counter
from typing import Any

import numpy as np

from ibrpipe.bench.settings import Setting
from ibrpipe.bench.speed_error.workloads import Workload
from ibrpipe.errors import IbrError
from ibrpipe.renderers.api import prepare, render
from ibrpipe.renderers.registry import find_renderer
from ibrpipe.types import Array, Camera, Frame, ReliefTexture

#: makes one frame and returns what is needed of it
Draw = Callable[[], Any]


@dataclass(frozen=True, eq=False)
class Ready:
    """A contender prepared for a workload.

    Attributes
    ----------
    depth : callable
        From a camera to a function that draws depth alone; None = it cannot.
    both : callable
        From a camera to a function that draws colour and depth.
    frame : callable
        From a camera to a `Frame` whose error is measured.
    milliseconds : float
        Time of preparing.
    bytes : int
        Held beyond the source.
    """

    depth: Callable[[Camera], Draw] | None
    both: Callable[[Camera], Draw] | None
    frame: Callable[[Camera], Frame]
    milliseconds: float
    bytes: int


@dataclass(frozen=True)
class Contender:
    """A setting or a peer.

    Attributes
    ----------
    label : str
    renderer : str
        Name in the registry; "peer" for the others.
    what : str
        One sentence.
    make : callable
        From a workload to `Ready`; None = does not apply.
    triangles : bool
        Renders the two triangles of each cell instead of its bilinear patch, and is compared with them.
    main : bool
        The first setting of its renderer: takes part in the curves of growth.
    options : mapping
    """

    label: str
    renderer: str
    what: str
    make: Callable[[Workload], Ready | None]
    triangles: bool = False
    main: bool = False
    options: Mapping[str, Any] = field(default_factory=dict)


def all_contenders(settings: Sequence[Setting], quick: bool) -> list[Contender]:
    """Return the settings that take part, then the peers."""
    found, seen = [], set()
    for setting in settings:
        if setting.only or (quick and not setting.quick):
            continue
        main = setting.renderer not in seen
        seen.add(setting.renderer)
        found.append(_of_setting(setting, main))
    embree = "Open3D's RaycastingScene (Embree) on the triangles, rays laid out beforehand, no colour looked up"
    flat = (
        "cv2.remap of the picture on its plane: one texel fetched for each pixel, no depth; the least a frame can cost"
    )
    return [
        *found,
        Contender("Embree", "peer", embree, _embree, triangles=True, main=True),
        Contender("flat picture", "peer", flat, _flat),
    ]


def _of_setting(setting: Setting, main: bool) -> Contender:
    entry = find_renderer(setting.renderer)

    def make(work: Workload) -> Ready | None:
        if not all(isinstance(source, entry.accepts) for source in work.sources):
            return None
        began = perf_counter()
        try:
            prepared = prepare(list(work.sources), setting.renderer)
        except IbrError:
            return None
        taken = 1e3 * (perf_counter() - began)

        def drawing(outputs: tuple[str, ...]) -> Callable[[Camera], Draw]:
            def aim(camera: Camera) -> Draw:
                return lambda: render(prepared, camera, setting.renderer, outputs, **setting.options)

            return aim

        def frame(camera: Camera) -> Frame:
            return render(prepared, camera, setting.renderer, **setting.options)

        return Ready(drawing(("depth",)), drawing(("color", "depth")), frame, taken, prepared.bytes)

    return Contender(setting.label, setting.renderer, entry.summary, make, False, main, dict(setting.options))


def _embree(work: Workload) -> Ready | None:
    from ibrpipe.embree import MeshCaster

    began = perf_counter()
    caster = MeshCaster(work.mesh)
    first = Camera.look_at((0, 0, 1), (0, 0, 0), width=1, height=1)
    caster.cast_camera(first)  # the tree is built when it is first asked
    taken = 1e3 * (perf_counter() - began)

    def frame(camera: Camera) -> Frame:
        depth = caster.cast_camera(camera).t
        rays = camera.pixel_rays()
        there = np.isfinite(depth)
        color = np.zeros((*depth.shape, 3))
        color[there] = _painted(work, camera.center + depth[there, None].astype(np.float64) * rays[there])
        return Frame(color.astype(np.float32), depth, there.astype(np.float32))

    held = work.mesh.vertices.nbytes // 2 + work.mesh.faces.nbytes
    return Ready(caster.prepared_cast, caster.prepared_cast, frame, taken, held)


def _painted(work: Workload, points: Array) -> Array:
    """Colour of the mesh at points (N, 3): bilinear in the height field's texels, else the object's own paint."""
    from ibrpipe.bench.speed_error.workloads import paint

    source = work.sources[0]
    if not isinstance(source, ReliefTexture):
        return paint(points / work.size)
    import cv2

    u, v, _ = source.frame.local_from_world @ (points - source.frame.origin).T
    places = np.stack([u - 0.5, v - 0.5], axis=-1).astype(np.float32)
    rows = max(1, -(-len(places) // 16384))  # cv2.remap takes at most 32767 rows
    padded = np.zeros((rows * 16384, 2), np.float32)
    padded[: len(places)] = places
    folded = padded.reshape(rows, 16384, 2)
    found = cv2.remap(source.color, folded, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(found.reshape(-1, 3)[: len(places)], np.float64)


def _flat(work: Workload) -> Ready | None:
    import cv2

    source = work.sources[0]
    if not isinstance(source, ReliefTexture):
        return None
    level = float(np.nanmean(source.height))
    began = perf_counter()
    image = np.dstack([np.rint(255.0 * source.color.clip(0, 1)), np.full(source.height.shape, 255)]).astype(np.uint8)
    taken = 1e3 * (perf_counter() - began)

    def aim(camera: Camera) -> tuple[Array, Array]:
        rays = camera.pixel_rays()
        with np.errstate(divide="ignore", invalid="ignore"):
            start = source.frame.local_from_world @ (camera.center - source.frame.origin)
            step = rays @ source.frame.local_from_world.T
            depth = (level - start[2]) / step[..., 2]
            places = start[:2] + depth[..., None] * step[..., :2]
        rows, columns = source.height.shape
        inside = (depth > 0) & (places > 0.5).all(axis=-1) & (places < (columns - 0.5, rows - 0.5)).all(axis=-1)
        return np.where(inside[..., None], places - 0.5, -10.0).astype(np.float32), np.where(inside, depth, np.inf)

    def both(camera: Camera) -> Draw:
        places, _ = aim(camera)
        return lambda: cv2.remap(image, places, None, cv2.INTER_LINEAR)

    def frame(camera: Camera) -> Frame:
        places, depth = aim(camera)
        found = cv2.remap(image, places, None, cv2.INTER_LINEAR)
        alpha = np.isfinite(depth).astype(np.float32)
        return Frame(found[..., :3].astype(np.float32) / 255.0 * alpha[..., None], depth.astype(np.float32), alpha)

    return Ready(None, both, frame, taken, image.nbytes)
