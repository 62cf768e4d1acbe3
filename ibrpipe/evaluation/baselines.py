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
from ibrpipe.types import Array, Camera, Frame

#: colours (N, 3) of points (N, 3) with normals (N, 3) seen from unit directions (N, 3); NaN where unknown
Shade = Callable[[Array, Array, Array], Array]


def render_ulr(camera: Camera, caster: MeshCaster, photos: PhotoSet) -> Frame:
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

    Returns
    -------
    Frame
        Colour (linear), depth along camera z, alpha (1 where some photo sees the surface).
    """
    return _shade_mesh(camera, caster, lambda points, normals, toward: photos.blend(points, normals, toward)[0])


def render_median(camera: Camera, caster: MeshCaster, photos: PhotoSet) -> Frame:
    """Give every pixel the per-channel median of all photos that see its surface point: the best diffuse mesh.

    Parameters and result as for `render_ulr`.
    """
    return _shade_mesh(camera, caster, lambda points, normals, _: photos.diffuse(points, normals)[0])


def _shade_mesh(camera: Camera, caster: MeshCaster, shade: Shade) -> Frame:
    hits = caster.cast_camera(camera)
    hit = np.isfinite(hits.t)
    rays = camera.pixel_rays()[hit]
    points = camera.center + rays * hits.t[hit][:, None].astype(np.float64)
    toward = -rays / np.linalg.norm(rays, axis=1, keepdims=True)
    shaded = shade(points, _facing(hits.normal[hit], toward), toward)
    known = np.asarray(np.isfinite(shaded).all(axis=1))
    color, alpha = np.zeros((*hit.shape, 3), np.float32), np.zeros(hit.shape, np.float32)
    color[hit], alpha[hit] = np.where(known[:, None], shaded, 0.0), known
    return Frame(color, hits.t, alpha, {"unseen": int((~known).sum())})


def _facing(normals: Array, toward: Array) -> Array:
    """Return normals turned to the side of the surface that is looked at."""
    behind = np.einsum("ij,ij->i", normals, toward)[:, None] < 0.0
    return np.where(behind, -normals, normals)
