"""Pictures of a reconstructed surface: shaded, how sure it is, and how far it is from the truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ibrpipe.embree import Hits, MeshCaster
from ibrpipe.evaluation.report.pictures import PAPER, jpeg
from ibrpipe.io.views import View
from ibrpipe.types import Array, Camera, Mesh

#: what the colours of the error pictures end at, share of the true surface's diagonal
WORST = 0.01
#: shown where no depth map saw the surface
PALE = (205, 208, 212)


@dataclass(frozen=True)
class SurfacePictures:
    """Pictures of one view of the surface as data URIs; None = not known."""

    name: str
    width: int
    height: int
    shaded: str
    confidence: str | None = None
    error: str | None = None
    missing: str | None = None


def draw_surface(
    mesh: Mesh, views: Sequence[View], width: int, confidence: Array | None = None, truth: Mesh | None = None
) -> list[SurfacePictures]:
    """Draw the surface as some views see it.

    Parameters
    ----------
    mesh : Mesh
    views : sequence of View
    width : int
        Of the pictures in pixels, at most.
    confidence : (V,) float32, optional
        Of the mesh's vertices.
    truth : Mesh, optional
    """
    caster = MeshCaster(mesh)
    true = None if truth is None else MeshCaster(truth)
    drawn = []
    for view in views:
        scale = min(1.0, width / view.camera.width)
        camera = view.camera.resized(round(view.camera.width * scale), round(view.camera.height * scale))
        hits = caster.cast_camera(camera)
        drawn.append(
            SurfacePictures(
                view.name,
                camera.width,
                camera.height,
                jpeg(shade(caster, hits, camera), width),
                None if confidence is None else jpeg(_confidence(mesh, hits, confidence), width),
                None if true is None else jpeg(_distances(hits, camera, true, _worst(true)), width),
                None
                if true is None
                else jpeg(_distances(true.cast_camera(camera), camera, caster, _worst(true)), width),
            )
        )
    return drawn


def error_colors() -> Array:
    """Colours of distances from 0 to the worst, (256, 3) uint8."""
    from matplotlib import colormaps

    return np.rint(255.0 * colormaps["turbo"](np.linspace(0.08, 0.95, 256))[:, :3]).astype(np.uint8)


def confidence_colors() -> Array:
    """Colours of confidence from 0 to 1, (256, 3) uint8."""
    from matplotlib import colormaps

    return np.rint(255.0 * colormaps["viridis"](np.arange(256))[:, :3]).astype(np.uint8)


def shade(caster: MeshCaster, hits: Hits, camera: Camera) -> Array:
    """Light the surface from the camera and a little from above; backs of faces are reddish. (H, W, 3) uint8."""
    met = hits.face >= 0
    picture = np.empty((*met.shape, 3), np.uint8)
    picture[:] = PAPER
    if not met.any():
        return picture
    normal = caster.smooth_normals(hits.face[met], hits.uv[met])
    rays = camera.pixel_rays()[met]
    facing = -(normal * rays).sum(axis=1) / np.linalg.norm(rays, axis=1)
    back = (hits.normal[met] * rays).sum(axis=1) > 0
    lamp = -(camera.R[2] + 0.7 * camera.R[1] + 0.5 * camera.R[0])
    lit = np.clip((normal * (lamp / np.linalg.norm(lamp))).sum(axis=1) * np.where(back, -1, 1), 0, 1)
    value = 30 + 130 * np.abs(facing) + 90 * lit
    tint = np.where(back[:, None], (1.0, 0.72, 0.68), (1.0, 0.985, 0.96))
    picture[met] = np.clip(value[:, None] * tint, 0, 255).astype(np.uint8)
    return picture


def _worst(truth: MeshCaster) -> float:
    return WORST * float(np.linalg.norm(np.ptp(truth.mesh.vertices, axis=0)))


def _confidence(mesh: Mesh, hits: Hits, confidence: Array) -> Array:
    met = hits.face >= 0
    picture = np.empty((*met.shape, 3), np.uint8)
    picture[:] = PAPER
    corners, uv = confidence[mesh.faces[hits.face[met]]], hits.uv[met]
    value = corners[:, 0] * (1 - uv.sum(axis=1)) + corners[:, 1] * uv[:, 0] + corners[:, 2] * uv[:, 1]
    unseen = (corners == 0).all(axis=1)[:, None]
    picture[met] = np.where(unseen, PALE, confidence_colors()[np.clip(255 * value, 0, 255).astype(int)])
    return picture


def _distances(hits: Hits, camera: Camera, other: MeshCaster, worst: float) -> Array:
    """Colour what a camera sees of one surface by its distance to another."""
    met = hits.face >= 0
    picture = np.empty((*met.shape, 3), np.uint8)
    picture[:] = PAPER
    points = camera.center + hits.t[met][:, None].astype(np.float64) * camera.pixel_rays()[met]
    apart = np.linalg.norm(points - other.closest(points)[0], axis=1)
    picture[met] = error_colors()[np.clip(255 * apart / worst, 0, 255).astype(int)]
    return picture
