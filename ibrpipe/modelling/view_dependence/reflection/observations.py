"""What the training photos say about the surface of the layers: one observation a pixel, and one a texel and photo."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ibrpipe.capture.photo_set import DEPTH_SLACK, PhotoSet
from ibrpipe.core.appearance.depth_edges import beside_edge
from ibrpipe.core.color import srgb_decode
from ibrpipe.embree import MeshCaster
from ibrpipe.errors import CaptureError
from ibrpipe.progress import track
from ibrpipe.renderers.ldi.renderer import find_hits
from ibrpipe.renderers.scene import Scene
from ibrpipe.renderers.view_dependence.mirror import LIFT, Looks, Surface, look, meet_surface
from ibrpipe.renderers.view_dependence.reflection import look_through
from ibrpipe.types import Array, Camera

#: weight of pixels beside a depth edge, and of a texel's own sample (times the root of n.v)
BESIDE_EDGE, OWN_SAMPLE = 0.3, 0.6
#: least n.v at which a texel's own sample is taken
STEEPEST = 0.1
#: traits that do not depend on normals: place in the patch, weight and observed colour
PLACE, SEEN = slice(0, 2), slice(5, 9)
#: observations that are looked at again at once
_AT_ONCE = 1 << 18


@dataclass(frozen=True, eq=False)
class Observations:
    """Observed colours of places on the surface; see :mod:`ibrpipe.core.reflection.model`.

    Attributes
    ----------
    where : (N, 2) int32
    traits : (N, 12) float32
    photo : (N,) int16, index of the photo
    toward : (N, 3) float32, from the place to the photo's eye, scene units
    met : (M,) int64
        Observations whose reflected ray meets the surface, ascending.
    met_where, met_traits : (M, 2) int32, (M, 12) float32
        The look at what it meets.
    """

    where: Array
    traits: Array
    photo: Array
    toward: Array
    met: Array
    met_where: Array
    met_traits: Array

    def subset(self, chosen: Array) -> Observations:
        """The observations with indices `chosen` (N',), in that order."""
        number = np.full(len(self.where), -1, np.int64)
        number[chosen] = np.arange(len(chosen))
        own = number[self.met]
        kept = np.flatnonzero(own >= 0)
        kept = kept[np.argsort(own[kept], kind="stable")]
        return Observations(
            self.where[chosen], self.traits[chosen], self.photo[chosen], self.toward[chosen], own[kept],
            self.met_where[kept], self.met_traits[kept],
        )  # fmt: skip

    def of_photos(self, wanted: Array) -> Observations:
        """The observations of the photos for which `wanted` (P,) is true."""
        return self.subset(np.flatnonzero(wanted[self.photo]))


def join(parts: Sequence[Observations]) -> Observations:
    """All observations of the parts, one after another."""
    firsts = np.cumsum([0] + [len(part.where) for part in parts])
    parts = [replace(part, met=part.met + first) for part, first in zip(parts, firsts, strict=False)]
    names = ("where", "traits", "photo", "toward", "met", "met_where", "met_traits")
    return Observations(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


def observe_pixels(
    scene: Scene, surface: Surface, photos: PhotoSet, size: int, most: int = 4_000_000, wanted: Array | None = None
) -> Observations:
    """Observe the surface through a checkerboard half of the photos' pixels inside the masks, or fewer.

    Parameters
    ----------
    scene : Scene
        Of the layers; hits are those that are drawn.
    surface : Surface
    photos : PhotoSet
    size : int
        Cells along a table's edge.
    most : int
        Observations at the most; every n-th pixel is taken so that about as many remain.
    wanted : (P,) bool or None
        Patches to observe; None = all.

    Raises
    ------
    CaptureError
        A photo holds NaN or infinite pixels.
    """
    step = max(2, int(np.ceil(np.count_nonzero(photos.mask >= 0.5) / most)))
    each = track(range(len(photos.cameras)), "observe")
    return join([_observe_photo(scene, surface, photos, p, size, step, wanted) for p in each])


def _observe_photo(
    scene: Scene, surface: Surface, photos: PhotoSet, p: int, size: int, step: int, wanted: Array | None
) -> Observations:
    camera, own = photos.cameras[p], photos.pixels_of(p)
    shape = camera.height, camera.width
    depth, mask = photos.depth[own].reshape(shape), photos.mask[own].reshape(shape)
    hits = find_hits(scene, camera)
    row, column = np.indices(shape)
    taken = agreed(hits.depth, depth, camera) & (mask >= 0.5) & ((row + column + p) % step == 0)
    if wanted is not None:
        taken[taken] = wanted[hits.ids[taken]]
    seen = look_through(surface, camera, hits.depth, hits.ids, taken, size)
    weight = mask[taken] * np.where(beside_edge(depth, mask)[taken], BESIDE_EDGE, 1.0)
    code, level = photos.code[own].reshape(*shape, 3), _clipped(photos.code[own])
    return _observations(surface, seen, weight, code[taken], level, photos.centers[p], p, size)


def agreed(drawn: Array, depth: Array, camera: Camera) -> Array:
    """Say where the layers as they are drawn and the mesh, depths (H, W), are one surface."""
    with np.errstate(invalid="ignore"):
        return np.isfinite(drawn) & (np.abs(drawn - depth) <= 2 * DEPTH_SLACK * depth / camera.K[0, 0])


def _clipped(code: Array) -> float:
    """Display code from which on a photo's pixels (N, 3) count as clipped: its brightest, where many are as bright."""
    if not np.isfinite(code).all():
        raise CaptureError("a photo holds NaN or infinite pixels; repair it")
    most = float(code.max(initial=0.0)) - 1e-4
    return most if np.count_nonzero(code >= most) >= 8 else np.inf


def _observations(
    surface: Surface, seen: Looks, weight: Array, code: Array, level: float, eye: Array, p: int, size: int
) -> Observations:
    """Fill in what was observed, and look where the reflected rays go."""
    known = np.isfinite(seen.reflected[:, 0])
    root = np.sqrt(srgb_decode(code))
    seen.traits[:, 5] = np.where(known, weight, 0.0)
    seen.traits[:, 6:9] = np.where(code >= level, -root, root)
    met, ends = meet_surface(surface, seen, size)
    photo, toward = np.full(len(seen.where), p, np.int16), (eye - seen.points).astype(np.float32)
    return Observations(seen.where, seen.traits, photo, toward, met, ends.where, ends.traits)


def look_again(observations: Observations, surface: Surface, centers: Array, size: int) -> Observations:
    """The same observations of a surface whose normals have changed; centers (P, 3) are the photos' eyes."""
    numbers = np.arange(len(observations.where))
    parts = [numbers[first : first + _AT_ONCE] for first in range(0, len(numbers), _AT_ONCE)]
    return join([_look_again(observations, part, surface, centers, size) for part in parts])


def _look_again(old: Observations, part: Array, surface: Surface, centers: Array, size: int) -> Observations:
    eyes = centers[old.photo[part]]
    seen = look(surface, eyes - old.toward[part], old.where[part, 0], eyes, size)
    seen.traits[:, PLACE], seen.traits[:, SEEN] = old.traits[part][:, PLACE], old.traits[part][:, SEEN]
    met, ends = meet_surface(surface, seen, size)
    return Observations(seen.where, seen.traits, old.photo[part], old.toward[part], met, ends.where, ends.traits)


def observe_texels(
    surface: Surface, points: Array, wanted: Array, caster: MeshCaster, photos: PhotoSet, size: int, every: int = 0
) -> Observations | None:
    """Observe samples of the layers at their own places, in photos that see them; None where none does.

    Parameters
    ----------
    points : (S, 3) float64, world, of the samples
    wanted : (S,) bool
        Samples to be observed in every photo.
    caster : MeshCaster
        The mesh that tells what hides a sample from a photo.
    every : int
        The others are observed in every so manieth photo, each sample in others than its neighbour; 0 = in none.
    """
    patch = np.full(len(points), -1, np.int64)
    first = surface.records[:, 4]
    patch[first[first >= 0]] = np.flatnonzero(first >= 0)
    parts = []
    for p in track(range(len(photos.cameras)), "texels"):
        sampled = (np.arange(len(points)) + p) % every == 0 if every else False
        chosen = np.flatnonzero((wanted | sampled) & (patch >= 0))
        toward = photos.centers[p] - points[chosen]
        cosine = (surface.normals[chosen] * toward).sum(axis=1) / np.linalg.norm(toward, axis=1)
        able = np.flatnonzero(cosine >= STEEPEST)
        at = chosen[able]
        code, _ = photos.subset([p]).blend_codes(points[at], surface.normals[at], toward[able])
        start = points[at] + LIFT * surface.texel * surface.normals[at]
        hidden = caster.occluded(start, photos.centers[p] - start, 0.0, 1.0)
        some = np.flatnonzero(np.isfinite(code[:, 0]) & ~hidden)
        seen = look(surface, points[at[some]], patch[at[some]], photos.centers[p], size)
        seen.traits[:, :2] = 0.0  # the patch's first corner, whatever the rounding
        weight = OWN_SAMPLE * np.sqrt(np.minimum(cosine[able[some]], 1.0))
        level = _clipped(photos.code[photos.pixels_of(p)])
        parts.append(_observations(surface, seen, weight, code[some], level, photos.centers[p], p, size))
    return join(parts) if sum(len(part.where) for part in parts) else None
