"""The fitter of the kind "photos": the training photos, cut to what they show of the object, kept with the asset."""

from __future__ import annotations

from dataclasses import asdict

import numpy as np
from pydantic import Field, ValidationError

from ibrpipe.capture.photo_set import PUBLISHED, PhotoSet
from ibrpipe.embree import MeshCaster
from ibrpipe.errors import FormatError
from ibrpipe.io.components import Component
from ibrpipe.io.documents.plan import PlannedComponent
from ibrpipe.io.kept_photos import PhotosFiles
from ibrpipe.modelling.view_dependence.fitter import FitJob, Fitted
from ibrpipe.modelling.view_dependence.residuals_file import ComponentFigures
from ibrpipe.modelling.view_dependence.work_units import context_of, forget
from ibrpipe.progress import track
from ibrpipe.types import Array, Camera
from ibrpipe.types.kept_photos import LEAST_BLENDED, MOST_BLENDED, MOST_SHARP, Blend, KeptPhoto, KeptPhotos, PhotoBlend

#: ways to mix photos that are tried, and photos that there must be to try them
TRIED = tuple(
    Blend(photos, falloff, sharpness)
    for photos, falloff in ((3, 0.0), (4, 0.0), (4, 0.75), (6, 0.75), (8, 1.0))
    for sharpness in (0.0, 0.5, 0.75)
)
LEAST = 8
#: photos that are predicted to choose between them, and pixels of each, at the most
PREDICTED, PIXELS = 8, 20_000
#: pixels around what a photo shows of the object that are kept, too: outlines of the asset are not those of the mesh
AROUND = 2
#: share of the codes that may lie above the brightest that is kept
CLIPPED = 1e-3
#: coverage from which a pixel shows the object, as where photos are blended
COVERED = 0.5


class PhotosPlan(PlannedComponent):
    """What a plan may say of photos that are kept."""

    blended: int | None = Field(
        None, ge=LEAST_BLENDED, le=MOST_BLENDED, description="Photos that a place asks; absent = chosen by photos"
    )
    falloff: float = Field(0.0, ge=0, le=MOST_SHARP, description="With blended: power of angles; 0 = as published")
    sharpness: float = Field(
        0.0, ge=0, le=MOST_SHARP, description="With blended: parameter of cubic convolution; 0 = bilinear"
    )


class PhotosFitter:
    """Photos that an asset keeps, for all its textures."""

    def fit(self, job: FitJob) -> Fitted:
        """Keep the training photos, and choose how many of them a place asks by photos that are left out.

        Raises
        ------
        CaptureError, FormatError
            The views, the mesh, the plan or the layers cannot be read.
        """
        if not job.wanted:
            return Fitted(())
        plan = _plan(job)
        try:
            context = context_of(job.sources)
            squares = {} if plan.blended else predict(context.photos, context.caster)
            how = Blend(plan.blended, plan.falloff, plan.sharpness) if plan.blended else best_of(squares)
            kept = keep(context.photos, how)
        finally:
            forget()
        shared = Component(kind=PhotoBlend.kind, **PhotosFiles().write_shared(kept, job.out, 100))
        told = [
            asdict(each) | {"psnr": round(float(-10 * np.log10(max(square, 1e-10))), 3)}
            for each, square in squares.items()
        ]
        figures = [
            ComponentFigures(
                name=job.plans[which].rectangle.name, texture=which, bytes=0, component=Component(kind=PhotoBlend.kind),
                photos=len(kept.photos), blend=asdict(kept.blend), left_out_psnr=told,
            )
            for which in job.wanted
        ]  # fmt: skip
        return Fitted(tuple(figures), shared)


def _plan(job: FitJob) -> PhotosPlan:
    planned = job.plans[job.wanted[0]].component(job.kind)
    try:
        return PhotosPlan.model_validate(planned.model_dump() if planned else {"kind": job.kind})
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join(str(part) for part in first["loc"])
        raise FormatError(f"photos in the plan: {where}: {first['msg']}; run the plan stage again") from error


def keep(photos: PhotoSet, how: Blend) -> KeptPhotos:
    """Return the photos as an asset keeps them: cut to the object, in bytes, without those that do not show it."""
    shown = [_shown(photos, p) for p in range(len(photos.cameras))]
    seen = [p for p, pixels in enumerate(shown) if pixels.any()]
    brightest = [photos.code[photos.pixels_of(p)][shown[p].ravel()].max(axis=1) for p in seen]
    top = max(1.0, float(np.quantile(np.concatenate(brightest), 1 - CLIPPED)))
    return KeptPhotos(tuple(_cut(photos, p, shown[p], top) for p in seen), top, how)


def _shown(photos: PhotoSet, p: int) -> Array:
    """(H, W) bool: what a photo shows of the object, and a little more."""
    import cv2

    camera, own = photos.cameras[p], photos.pixels_of(p)
    shape = (camera.height, camera.width)
    surface = np.isfinite(photos.depth[own]).reshape(shape).astype(np.uint8)
    around = cv2.dilate(surface, np.ones((2 * AROUND + 1, 2 * AROUND + 1), np.uint8)) > 0
    return np.asarray(around & (photos.mask[own].reshape(shape) >= COVERED))


def _cut(photos: PhotoSet, p: int, shown: Array, top: float) -> KeptPhoto:
    camera, code = photos.cameras[p], photos.code[photos.pixels_of(p)].reshape(*shown.shape, 3)
    window = _around(np.asarray(shown.any(axis=1))), _around(np.asarray(shown.any(axis=0)))
    codes = np.clip(np.round(np.nan_to_num(code[window]) * (255.0 / top)), 0, 255).astype(np.uint8)
    return KeptPhoto(_moved(camera, window), codes, shown[window])


def _around(there: Array) -> slice:
    """Indices from the first to the last that is true, and one beyond either, which bilinear look-ups ask for."""
    found = np.flatnonzero(there)
    return slice(max(int(found[0]) - 1, 0), min(int(found[-1]) + 2, len(there)))


def _moved(camera: Camera, window: tuple[slice, slice]) -> Camera:
    """Return the camera of a part of its picture."""
    rows, columns = window
    K = camera.K - np.array([[0, 0, columns.start], [0, 0, rows.start], [0, 0, 0]])
    return Camera(K, camera.cam_from_world, columns.stop - columns.start, rows.stop - rows.start)


def predict(photos: PhotoSet, caster: MeshCaster) -> dict[Blend, float]:
    """Mean squares, in display code, of photos predicted by others, by how; empty where there are too few photos."""
    count = len(photos.cameras)
    if count < LEAST:
        return {}
    squares = dict.fromkeys(TRIED, 0.0)
    chosen = np.unique(np.linspace(0, count - 1, min(PREDICTED, count)).round().astype(int)).tolist()
    for p in track(chosen, "photos predicted by others"):
        others = photos.subset([q for q in range(count) if q != p])
        points, normals, toward, truth = _places(photos, p, caster)
        for how in TRIED:
            code, seen = others.blend_codes(points, normals, toward, how)
            error = (np.clip(code[seen > 0], 0.0, 1.0) - np.minimum(truth[seen > 0], 1.0)).astype(np.float64) ** 2
            squares[how] += float(error.mean()) / len(chosen) if len(error) else 0.0
    return squares


def best_of(squares: dict[Blend, float]) -> Blend:
    """How photos are predicted best; as gong-yang mixes them where nothing was tried."""
    return min(squares, key=lambda how: squares[how]) if squares else PUBLISHED


def _places(photos: PhotoSet, p: int, caster: MeshCaster) -> tuple[Array, Array, Array, Array]:
    """Points (N, 3), normals, unit directions to the camera, and codes of pixels of one photo, evenly spread."""
    camera, own = photos.cameras[p], photos.pixels_of(p)
    good = np.flatnonzero(np.isfinite(photos.depth[own]) & (photos.mask[own] >= 0.95))
    good = good[:: max(1, -(-len(good) // PIXELS))]
    rows, columns = np.divmod(good, camera.width)
    rays = camera.pixel_rays(np.stack([columns, rows], axis=1) + 0.5)
    hits = caster.cast(np.broadcast_to(camera.center, rays.shape), rays)
    hit = np.isfinite(hits.t)
    rays, good = rays[hit], good[hit]
    toward = -rays / np.linalg.norm(rays, axis=1, keepdims=True)
    behind = np.einsum("ij,ij->i", hits.normal[hit], toward)[:, None] < 0
    normals = np.where(behind, -hits.normal[hit], hits.normal[hit])
    return camera.center + rays * hits.t[hit][:, None].astype(np.float64), normals, toward, photos.code[own][good]


def bytes_of_photos(photos: PhotoSet, per_pixel: float) -> float:
    """Bytes that the photos of a set are expected to take, by their pixels that show the object."""
    return per_pixel * sum(int(_shown(photos, p).sum()) for p in range(len(photos.cameras)))
