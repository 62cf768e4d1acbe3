"""Captures and runs without an asset as pages: photos as frusta, sparse points, the mesh."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ibrpipe.errors import CaptureError
from ibrpipe.export.page.capture_scene import CaptureScene
from ibrpipe.export.page.document import Page, page_text
from ibrpipe.export.page.geometry import pack_mesh, pack_points
from ibrpipe.export.page.notes import PageNotes
from ibrpipe.export.page.packing import Packer
from ibrpipe.export.page.photos import Picture, load_pictures, pack_photos, told_size, webp
from ibrpipe.export.page.view import middle_direction, up_in
from ibrpipe.types import Array, Camera
from ibrpipe.types.bounds import ball_around, meeting_point

#: share of sparse points that count as strays on either side of an axis
STRAYS = 0.02
#: what surrounds the place that cameras look at, of their distance, where nothing else is known
AROUND = 0.4
#: how much the first view looks from above, of its horizontal part
ABOVE = 0.6
#: colour of points that no photo shows any more
GREY = 128


def make_capture_page(scene: CaptureScene, notes: PageNotes) -> Page:
    """Return a page that shows a capture.

    Raises
    ------
    FormatError, CaptureError
        A photo is damaged or has another size than its camera, or none is left.
    """
    views = (*scene.train, *scene.test)
    pictures = load_pictures(views)
    if not pictures:
        raise CaptureError(f"{scene.name}: none of its {len(views)} photos can be found; put them where they were")
    packer = Packer()
    photos = pack_photos(pictures, packer)
    cameras = [view.camera for view in views]
    up = up_in(notes, [view.camera for view in scene.train])
    meta = {
        "surfaces": [],
        "components": {},
        "photos": photos,
        "mesh": None if scene.mesh is None else pack_mesh(scene.mesh, scene.confidence, packer),
        "points": _points(scene, pictures, packer),
        "units": notes.units,
        "notes": [each.model_dump() for each in notes.annotations],
        "views": [each.model_dump() for each in notes.views],
        **_placed(scene, cameras, up),
    }
    notes = notes.model_copy(update={"title": notes.title or scene.name})
    told = "; ".join((told_size(pictures, photos), *scene.told))
    return Page(page_text(notes, meta, packer.encoded(), webp(pictures[0].color)), told)


def _points(scene: CaptureScene, pictures: Sequence[Picture], packer: Packer) -> dict[str, Any] | None:
    if scene.points is None or scene.first_view is None:
        return None
    return pack_points(scene.points, point_colors(scene, pictures), packer)


def point_colors(scene: CaptureScene, pictures: Sequence[Picture]) -> Array:
    """Return the colours of a scene's points as the first photo that sees each shows it, (P, 3) uint8 sRGB."""
    assert scene.points is not None
    index = {view.name: number for number, view in enumerate(scene.train)}
    found = np.full((len(scene.points), 3), GREY, np.uint8)
    for picture in pictures:
        number = None if picture.view.held_out else index.get(picture.view.name)
        own = np.flatnonzero(scene.first_view == number)
        camera = picture.view.camera
        x, y, z = (scene.points[own] @ camera.pixel_from_world[:, :3].T + camera.pixel_from_world[:, 3]).T
        with np.errstate(divide="ignore", invalid="ignore"):
            x, y = x / z, y / z
        inside = (z > 0) & (x >= 0) & (x < camera.width) & (y >= 0) & (y < camera.height)
        found[own[inside]] = picture.color[y[inside].astype(int), x[inside].astype(int)]
    return found


def _placed(scene: CaptureScene, cameras: Sequence[Camera], up: Array) -> dict[str, Any]:
    """Where the scene is, how far its cameras reach, where its floor is, and the first view of all of it."""
    places = _places(scene)
    center, radius = ball_around(places) if len(places) else _looked_at(cameras)
    away = [camera.center - center for camera in cameras]
    toward = middle_direction(away, up)
    toward = toward - (toward @ up) * up + ABOVE * up
    heights = (places if len(places) else np.array([center - radius * up])) @ up
    return {
        "bounds": {"centre": center.tolist(), "radius": radius},
        "reach": max(radius, *(float(np.linalg.norm(each)) for each in away)),
        "floor": float(heights.min()),
        "start": {"up": up.tolist(), "from": (toward / np.linalg.norm(toward)).tolist()},
    }


def _places(scene: CaptureScene) -> Array:
    """Positions (N, 3) that say where the scene is: the mesh, else the points without strays."""
    if scene.mesh is not None:
        return scene.mesh.mesh.vertices
    if scene.points is None:
        return np.zeros((0, 3))
    low, high = np.quantile(scene.points, (STRAYS, 1 - STRAYS), axis=0)
    kept = ((scene.points >= low) & (scene.points <= high)).all(axis=1)
    return scene.points[kept] if kept.any() else scene.points


def _looked_at(cameras: Sequence[Camera]) -> tuple[Array, float]:
    center, distance = meeting_point(cameras)
    return center, AROUND * distance or 1.0
