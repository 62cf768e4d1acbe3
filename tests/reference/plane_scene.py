"""Photos of a painted plane from five places, with masks, sparse points and the true depth."""

import numpy as np

from ibrpipe.io.photos.images import write_png
from ibrpipe.io.points import SparsePoints
from ibrpipe.io.views import View
from ibrpipe.types import Camera

WIDTH, HEIGHT = 96, 72
#: the surface: plane n . X = 1
NORMAL = np.array([0.1, -0.05, 0.25])
PLACES = [(-0.6, 0, 0), (0, 0, 0), (0.6, 0.1, 0), (0.1, 0.5, 0), (-0.2, -0.5, 0)]


def rays(camera):
    x, y = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
    return np.stack([x, y, np.ones_like(x)], axis=-1) @ camera.world_from_pixel.T


def true_depth(camera):
    return (1 - NORMAL @ camera.center) / (rays(camera) @ NORMAL)


def camera_at(place, up=(0, -1, 0)):
    return Camera.look_at(place, [0, 0, 4.0], up=up, fov_y_deg=45, width=WIDTH, height=HEIGHT)


def take(folder, name, camera):
    """Write a photo and its mask, which leaves out the six columns on the left; return the view."""
    points = camera.center + rays(camera) * true_depth(camera)[..., None]
    s, t = 3 * points[..., 0], 3 * points[..., 1]
    paint = 0.5 + 0.2 * np.sin(3 * s + t) * np.cos(2 * t) + 0.2 * np.sin(5 * t - 2 * s + np.sin(3 * s))
    write_png(folder / f"{name}.png", np.repeat(paint[..., None], 3, axis=2).astype(np.float32))
    mask = np.zeros((camera.height, camera.width, 3), np.float32)
    mask[:, 6:] = 1
    write_png(folder / f"{name}.mask.png", mask)
    return View(str(name), camera, folder / f"{name}.png", mask=folder / f"{name}.mask.png")


def sparse(views):
    x, y = np.meshgrid(np.linspace(-1, 1, 8), np.linspace(-0.8, 0.8, 6))
    xyz = np.stack([x.ravel(), y.ravel(), (1 - NORMAL[0] * x - NORMAL[1] * y).ravel() / NORMAL[2]], axis=1)
    count, every = len(xyz), len(views)
    return SparsePoints(
        xyz, np.zeros(count, np.float32), np.arange(count + 1) * every, np.tile(np.arange(every), count)
    )
