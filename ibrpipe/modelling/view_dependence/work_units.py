"""Work units of the residuals stage: they take paths and numbers, and find their data in a cache of their process.

Threads of one process share one context; a process elsewhere loads its own from the same files. A texel's value does
not depend on which unit computes it, so results are the same for any executor.
"""

from __future__ import annotations

import dataclasses
import threading
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ibrpipe.capture.photo_set import PhotoSet, load_photos
from ibrpipe.core.color import srgb_encode
from ibrpipe.embree import MeshCaster
from ibrpipe.io.layers import read_layers
from ibrpipe.io.surfaces.meshes import read_mesh
from ibrpipe.io.views import read_views
from ibrpipe.modelling.diffuse import DiffuseSource
from ibrpipe.modelling.plan_file import TexturePlan, read_plan
from ibrpipe.modelling.sides import caster_of
from ibrpipe.modelling.view_dependence.spiral_images import cast_image, spiral_images
from ibrpipe.types import Array, LayeredDepthImage

Stamp = tuple[tuple[str, int], ...]


@dataclass(frozen=True)
class Sources:
    """Files that a unit needs: `views.json`, `mesh.ply`, `plan.json`, the folder of the layers, `sides.npz` if any."""

    views: Path
    mesh: Path
    plan: Path
    layers: Path
    sides: Path | None = None

    def stamp(self) -> Stamp:
        """Paths with the times of their last change, nanoseconds."""
        files = [self.views, self.mesh, self.plan, self.layers / "layers.json", *([self.sides] if self.sides else [])]
        return tuple((str(file), file.stat().st_mtime_ns if file.exists() else 0) for file in files)


@dataclass(frozen=True, eq=False)
class Context:
    """What the sources hold, loaded and prepared."""

    caster: MeshCaster
    photos: PhotoSet
    plans: tuple[TexturePlan, ...]
    layers: tuple[LayeredDepthImage, ...]
    diffuse: DiffuseSource


_LOCK = threading.Lock()
_CONTEXTS: dict[Stamp, Context] = {}
_ERRORS: dict[Stamp, PhotoSet] = {}


def context_of(sources: Sources) -> Context:
    """Load the sources, or return what this process has loaded already; only the latest sources are kept.

    Raises
    ------
    CaptureError, FormatError, MissingFileError
        A source cannot be read.
    """
    key = sources.stamp()
    with _LOCK:
        if key not in _CONTEXTS:
            _CONTEXTS.clear()
            _CONTEXTS[key] = _load(sources)
        return _CONTEXTS[key]


def _load(sources: Sources) -> Context:
    plans = read_plan(sources.plan)
    layers = tuple(read_layers(sources.layers / f"texture_{i:02d}" / "layers.exr") for i in range(len(plans)))
    caster = caster_of(read_mesh(sources.mesh), sources.sides)
    photos = load_photos(read_views(sources.views).train, caster)
    return Context(caster, photos, tuple(plans), layers, DiffuseSource([plan.rectangle for plan in plans], layers))


def forget() -> None:
    """Drop everything that this process has loaded."""
    with _LOCK:
        _CONTEXTS.clear()
        _ERRORS.clear()


def _errors_of(path: Path, photos: PhotoSet) -> PhotoSet:
    """Photos whose pixels are the errors (T, 3) float32 in the NumPy file `path`."""
    key = ((str(path), path.stat().st_mtime_ns),)
    with _LOCK:
        if key not in _ERRORS:
            _ERRORS.clear()
            _ERRORS[key] = dataclasses.replace(photos, code=np.load(path))
        return _ERRORS[key]


def forget_errors() -> None:
    """Drop the photos' errors that this process has loaded."""
    with _LOCK:
        _ERRORS.clear()


def sample_images(sources: Sources, which: int, closed: bool, first: int, last: int) -> tuple[Array, Array]:
    """Sample images `first` to `last` (exclusive) of texture `which` (gong-yang, sec. 4.2).

    Returns
    -------
    difference : (T, 3) float32
        Colour seen along the image's direction minus diffuse colour, in display code (1 = white); NaN = none.
    base : (T, 3) float32
        Diffuse colour, linear; NaN = none.
    """
    context = context_of(sources)
    plan = context.plans[which]
    differences, bases = [], []
    for image in spiral_images(plan, closed)[1][first:last]:
        difference, base = (np.full((image.texels, 3), np.nan, np.float32) for _ in range(2))
        for surface in cast_image(plan.rectangle.edges, image, context.caster):
            code, _ = context.photos.blend_codes(surface.points, surface.normals, surface.toward)
            base[surface.texel] = context.diffuse.at(surface.points, surface.normals)
            difference[surface.texel] = code - srgb_encode(base[surface.texel], np.inf)
        differences.append(difference)
        bases.append(base)
    return np.concatenate(differences), np.concatenate(bases)


def project_errors(sources: Sources, errors: Path, which: int, closed: bool, first: int, last: int) -> Array:
    """Blend the photos' errors (a NumPy file) into images `first` to `last`, (T, 3) float32; 0 where there are none."""
    context = context_of(sources)
    plan, photos = context.plans[which], _errors_of(errors, context.photos)
    corrections = []
    for image in spiral_images(plan, closed)[1][first:last]:
        correction = np.zeros((image.texels, 3), np.float32)
        for surface in cast_image(plan.rectangle.edges, image, context.caster):
            code, _ = photos.blend_codes(surface.points, surface.normals, surface.toward)
            correction[surface.texel] = np.nan_to_num(code, nan=0.0)
        corrections.append(correction)
    return np.concatenate(corrections)
