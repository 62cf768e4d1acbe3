"""Plain methods to show the same capture, for comparison: unstructured lumigraph and a mesh in median colours.

Source: buehler2001; the photos of a pixel are chosen and weighted as in gong-yang, sec. 4.2.
Both cast the capture's mesh by Embree and ask the training photos anew at every pixel, so that nothing is lost to
textures, spirals or codes. Which photos see a point is decided as everywhere else (`photos.PhotoSet`). Surface that no
photo sees stays black and uncovered.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ibrpipe.capture.photo_set import PhotoSet
from ibrpipe.embree import MeshCaster
from ibrpipe.renderers.antialiasing import supersample
from ibrpipe.renderers.edges import PLACES, edge_pixels
from ibrpipe.renderers.pixel_grid import PixelGrid
from ibrpipe.types import Array, Camera, Frame

#: colours (N, 3) of points (N, 3) with normals (N, 3) seen from unit directions (N, 3); NaN where unknown
Shade = Callable[[Array, Array, Array], Array]

#: rays of a pixel, or "adaptive"
Samples = int | str
EVERYTHING = ("color", "depth", "alpha")


def render_ulr(camera: Camera, caster: MeshCaster, photos: PhotoSet, samples: Samples = 1) -> Frame:
    """Blend, at every pixel, the best four photos by angle: an unstructured lumigraph.

    The weight of photo i is ``dot_i - dot_4``, normalised, where ``dot`` is the cosine between the directions from the
    surface point to the photo and to the eye, over the photos that see the point: three photos count, and each fades
    to nothing before it is replaced (gong-yang, sec. 4.2).

    Parameters
    ----------
    camera : Camera
    caster : MeshCaster
        The capture's mesh.
    photos : PhotoSet
        All training photos with the mesh's depth.
    samples : int or "adaptive"
        Rays of a pixel, as renderers take them; adaptive = several where a pixel shows an edge.

    Returns
    -------
    Frame
        Colour (linear), depth along camera z, alpha (1 where some photo sees the surface).
    """
    return _shade_mesh(
        camera, caster, lambda points, normals, toward: photos.blend(points, normals, toward)[0], samples
    )


def render_median(camera: Camera, caster: MeshCaster, photos: PhotoSet, samples: Samples = 1) -> Frame:
    """Give every pixel the per-channel median of all photos that see its surface point: the best diffuse mesh.

    Parameters and result as for `render_ulr`.
    """
    return _shade_mesh(camera, caster, lambda points, normals, _: photos.diffuse(points, normals)[0], samples)


def _shade_mesh(camera: Camera, caster: MeshCaster, shade: Shade, samples: Samples) -> Frame:
    if isinstance(samples, int) and samples > 1:
        return supersample(lambda view, _: _shade_mesh(view, caster, shade, 1), camera, EVERYTHING, samples)
    shape, pixels = (camera.height, camera.width), PixelGrid.centers(camera.height, camera.width).points.reshape(-1, 2)
    color, depth, known = _shade_rays(camera, caster, shade, pixels)
    color, depth, alpha = color.reshape(*shape, 3), depth.reshape(shape), known.reshape(shape).astype(np.float32)
    unseen = int((np.isfinite(depth) & (alpha == 0)).sum())
    if samples == "adaptive":
        row, column = np.nonzero(edge_pixels(depth, alpha))
        if len(row) == 0:
            return Frame(color, depth, alpha, {"unseen": unseen})
        places = np.stack([column, row], axis=1)[:, None] + PLACES
        several, _, seen = _shade_rays(camera, caster, shade, places.reshape(-1, 2))
        weight = seen.reshape(*places.shape[:2], 1).astype(np.float32)
        total = weight.sum(axis=1)
        color[row, column] = (several.reshape(*places.shape[:2], 3) * weight).sum(axis=1) / np.maximum(total, 1)
        alpha[row, column] = total[:, 0] / len(PLACES)
    return Frame(color, depth, alpha, {"unseen": unseen})


def _shade_rays(camera: Camera, caster: MeshCaster, shade: Shade, pixels: Array) -> tuple[Array, Array, Array]:
    """Colours (N, 3), depths along camera z and whether the colour is known (N,), of rays through (N, 2) pixels."""
    rays = camera.pixel_rays(pixels)
    hits = caster.cast(np.broadcast_to(camera.center, rays.shape), rays)
    hit = np.isfinite(hits.t)
    points = camera.center + rays[hit] * hits.t[hit][:, None].astype(np.float64)
    toward = -rays[hit] / np.linalg.norm(rays[hit], axis=1, keepdims=True)
    shaded = shade(points, _facing(hits.normal[hit], toward), toward)
    seen = np.asarray(np.isfinite(shaded).all(axis=1))
    color, known = np.zeros((len(rays), 3), np.float32), np.zeros(len(rays), bool)
    color[hit], known[hit] = np.where(seen[:, None], shaded, 0.0), seen
    return color, hits.t, known


def _facing(normals: Array, toward: Array) -> Array:
    """Return normals turned to the side of the surface that is looked at."""
    behind = np.einsum("ij,ij->i", normals, toward)[:, None] < 0.0
    return np.where(behind, -normals, normals)
