"""Photo-consistency of a surface: the measure by which the outlines alone are held against depth.

A photo is reprojected over the surface into another one and compared there, window by window, by normalised
cross-correlation (NCC). Whatever the surface was made from, a better one gives a higher correlation.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ibrpipe.embree import MeshCaster
from ibrpipe.io.views import View
from ibrpipe.progress import Step
from ibrpipe.reconstruction.depth.image_pyramid import Picture, forget_pictures, picture_of
from ibrpipe.types import Array, Mesh

CONSISTENCY = Step("photo-consistency", 0.1)
#: photos that are compared, and how many are reprojected into each
PHOTOS, PARTNERS = 12, 2
#: angle between photos that is looked for: enough for depth to show, little enough for shine to stay, degrees
APART = 15.0
#: pixels of a photo that are looked at, most
MOST_PIXELS = 300_000
#: half the width of a window, pixels; grey values of 255 that it must spread
_HALF, _SPREAD = 3, 2.0
#: share of the distance by which surface must lie before a point to hide it
_HIDES = 0.005
#: standard errors by which a surface must be better
SURE = 2.0


def photo_consistency(meshes: Sequence[Mesh], views: Sequence[View], middle: Array) -> Array:
    """Return the photo-consistency of surfaces, (photos, meshes) float64, 0 to 1.

    It is the mean correlation with other photos, reprojected, over the windows of a photo's mask that have any
    texture; 0 where the surface is missing, or hidden from the other photo.

    Parameters
    ----------
    meshes : sequence of Mesh
    views : sequence of View
        At least three.
    middle : (3,) float64
        Of the object.
    """
    casters, chosen = [MeshCaster(mesh) for mesh in meshes], views[:: max(1, -(-len(views) // PHOTOS))]
    found = np.zeros((len(chosen), len(meshes)))
    for row, view in enumerate(CONSISTENCY.track(chosen)):
        here = _picture(view)
        others = [_picture(each) for each in partners(view, views, middle)]
        for column, caster in enumerate(casters):
            points = _surface(caster, here)
            found[row, column] = np.mean([masked_ncc(here, *_reprojected(caster, points, other)) for other in others])
    forget_pictures()
    return found


def surely_better(first: Array, second: Array) -> bool:
    """Say whether the first of two columns of figures (photos,) is greater by more than chance."""
    apart = first - second
    return bool(len(apart) > 2 and apart.mean() > SURE * apart.std(ddof=1) / len(apart) ** 0.5)


def partners(view: View, views: Sequence[View], middle: Array) -> list[View]:
    """Return the photos that are about `APART` degrees away, seen from the middle."""
    rest = [each for each in views if each.name != view.name]
    toward = np.stack([each.camera.center - middle for each in [view, *rest]])
    toward /= np.linalg.norm(toward, axis=1, keepdims=True)
    angle = np.degrees(np.arccos(np.clip(toward[1:] @ toward[0], -1.0, 1.0)))
    return [rest[index] for index in np.argsort(np.abs(angle - APART), kind="stable")[:PARTNERS]]


def _picture(view: View) -> Picture:
    width, height = view.camera.width, view.camera.height
    scale = min(1.0, (MOST_PIXELS / (width * height)) ** 0.5)
    return picture_of(view, max(1, round(width * scale)), max(1, round(height * scale)))


def _surface(caster: MeshCaster, here: Picture) -> Array:
    """Points (H, W, 3) of the front that the pixels of the mask show; NaN elsewhere."""
    hits, rays = caster.cast_camera(here.camera), here.camera.pixel_rays()
    front = (hits.face >= 0) & ((hits.normal * rays).sum(axis=2) < 0) & (here.valid > 0)
    return here.camera.center + np.where(front, hits.t, np.nan)[..., None] * rays


def _reprojected(caster: MeshCaster, points: Array, other: Picture) -> tuple[Array, Array]:
    """Grey values (H, W) of another photo at the points, and where it shows them (H, W) bool."""
    import cv2

    camera, shown = other.camera, np.isfinite(points[..., 0])
    where = points[shown]
    seen = where @ camera.R.T + camera.t
    z = np.where(seen[:, 2] > 0, seen[:, 2], 1.0)
    x, y = ((seen @ camera.K.T)[:, :2] / z[:, None]).T
    inside = (seen[:, 2] > 0) & (x > 0.5) & (y > 0.5) & (x < camera.width - 0.5) & (y < camera.height - 0.5)
    inside &= ~(caster.cast(camera.center, where - camera.center).t < 1 - _HIDES)
    column, row = np.zeros(shown.shape, np.float32), np.zeros(shown.shape, np.float32)
    column[shown], row[shown] = x - 0.5, y - 0.5
    seen_there = shown.copy()
    seen_there[shown] = inside
    return cv2.remap(other.grey, column, row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE), seen_there


def masked_ncc(here: Picture, reprojected: Array, shown: Array) -> float:
    """Mean correlation of a picture with one `reprojected` (H, W) where `shown`, in windows with texture."""
    import cv2

    def mean(values: Array) -> Array:
        return cv2.boxFilter(values, -1, (2 * _HALF + 1, 2 * _HALF + 1), borderType=cv2.BORDER_REFLECT)

    def spread(values: Array, weight: Array) -> Array:
        share = np.maximum(mean(weight), 1e-6)
        return mean(values * values * weight) / share - (mean(values * weight) / share) ** 2

    inside, both = here.valid.astype(np.float64), shown.astype(np.float64)
    a, b = here.grey.astype(np.float64), np.where(shown, reprojected, 0).astype(np.float64)
    told = (inside > 0) & (spread(a, inside) > _SPREAD**2)
    share = np.maximum(mean(both), 1e-6)
    joint = mean(a * b * both) / share - mean(a * both) * mean(b * both) / share**2
    size = np.sqrt(np.maximum(spread(a, both) * spread(b, both), 1e-12))
    value = np.where(shown & (mean(both) > 0.5) & (size > 1e-3), np.clip(joint / size, 0.0, 1.0), 0.0)
    return float(value[told].mean()) if told.any() else 0.0
