"""Several maps in one picture: the nearest hit of all counts."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ibrpipe.bench.cases.case import PLAIN, CompositeCase, Shot, colors, look, relief, rough
from ibrpipe.types import Camera, DepthImage

SEEN = look((-4.0, -6.0, 15.0), (7.5, 6.0, 1.0), 50.0)


def _crossing() -> list[Shot]:
    """Two reliefs that pass through each other."""
    return [relief(PLAIN, rough(seed=seed), SEEN, tint) for seed, tint in ((1, None), (2, colors((12, 15))[::-1]))]


def _twice() -> list[Shot]:
    one = relief(PLAIN, rough(), SEEN)
    return [one, relief(PLAIN, rough(), SEEN, 1.0 - colors((12, 15)))]


def _relief_and_depth_image() -> list[Shot]:
    """A ball, seen by a depth image, half sunk in a relief."""
    image = _ball(Camera.look_at((7.5, 6.0, 9.0), (7.5, 6.0, 1.5), (0, 1, 0), 50.0, 24, 24), (7.5, 6.0, 1.5), 2.5)
    return [relief(PLAIN, rough(), SEEN), Shot(image, SEEN)]


def _six_images() -> list[Shot]:
    """A ball in six depth images round it, as the paper's globe."""
    camera = look((2.1, -1.7, 1.3), (0, 0, 0), 55.0)
    eyes = [sign * 2.5 * axis for axis in np.eye(3) for sign in (1.0, -1.0)]
    ups = [(0, 0, 1) if eye[2] == 0 else (0, 1, 0) for eye in eyes]
    views = [Camera.look_at(eye, (0, 0, 0), up, 47.5, 24, 24) for eye, up in zip(eyes, ups, strict=True)]
    return [Shot(_ball(view, (0, 0, 0), 1.0), camera) for view in views]


def _ball(camera: Camera, middle: tuple[float, float, float], radius: float) -> DepthImage:
    """Return the closed-form picture of a ball, painted by its normals."""
    rays = camera.pixel_rays()
    apart = camera.center - np.array(middle)
    a, b, c = (rays * rays).sum(axis=-1), rays @ apart, apart @ apart - radius**2
    root = b * b - a * c
    depth = np.where(root > 0, (-b - np.sqrt(np.maximum(root, 0.0))) / a, np.inf)
    there = np.isfinite(depth)[..., None]
    normal = (apart + np.where(there, depth[..., None], 0.0) * rays) / radius
    return DepthImage(camera, np.where(there, 0.5 + 0.4 * normal, 0.0), depth)


def composite_cases() -> Iterator[CompositeCase]:
    """Yield the cases of group 4 with several maps."""
    tie = "both maps are equally near: either colour is right"
    yield CompositeCase("maps-crossing", 4, "two reliefs that pass through each other", _crossing)
    yield CompositeCase("maps-twice-the-same", 4, "one relief twice, in other colours", _twice, colors_tie=tie)
    yield CompositeCase("maps-relief-and-depth-image", 4, "a ball half sunk in a relief", _relief_and_depth_image)
    yield CompositeCase("maps-six-depth-images", 4, "a ball in six depth images that overlap", _six_images)
