"""How far a rendered frame is from the exact answer: in texels along the ray, and in pixels of the picture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ibrpipe.bench.oracles import fields, kernels
from ibrpipe.bench.oracles.surface import Surface
from ibrpipe.types import Array, Camera, Frame

#: error along the ray, in texels, from which a hit counts as one of another surface
ASTRAY = 1.0
#: share of a texel by which the hits of a doubtful pixel differ at least
DOUBTFUL = 1e-3
#: widest texel, in pixels, by which the exact picture may be shifted for `Errors.gross`
REACH = 6


@dataclass(frozen=True)
class Errors:
    """Errors of one frame.

    Attributes
    ----------
    pixels, hits : int
        Pixels of the frame, and of the exact answer's surface.
    doubtful : int
        Pixels whose hit rounding may move: silhouettes, rays along cracks, an eye on the surface.
    lost, extra, astray : int
        Pixels that should be hit and are not; are hit and should not be; show a place over a texel away along the ray.
    gross : int
        Wrong pixels that stay wrong when the exact picture may be shifted by a texel (or a pixel, the larger): not
        what resampling does at silhouettes.
    nan : int
        Pixels with NaN in any output.
    texels, texels_p99 : float
        Largest and 99th-percentile distance along the ray from the exact hit, in texels.
    shift, shift_p99 : float
        The same in pixels: from where a shown texel is to where it belongs in the picture.
    off, off_p99 : float
        The same in texels of depth: from the shown point to the surface at its own texel.
    codes, codes_p99 : float
        Error of the colour in 8-bit codes of linear light (of the colour itself where it is above 1), over clear hits
        that are not astray.
    rmse : float
        Root mean square distance along the ray in texels, over clear hits that are not astray.
    """

    pixels: int
    hits: int
    doubtful: int
    lost: int
    extra: int
    astray: int
    gross: int
    nan: int
    texels: float
    texels_p99: float
    shift: float
    shift_p99: float
    off: float
    off_p99: float
    codes: float
    codes_p99: float
    rmse: float

    @property
    def wrong(self) -> int:
        """Pixels lost, extra or astray."""
        return self.lost + self.extra + self.astray


@dataclass(frozen=True, eq=False)
class ErrorMaps:
    """Where errors sit: (H, W) float64 texels along the ray, NaN where nothing is to be compared; (H, W) bool wrong."""

    texels: Array
    wrong: Array
    clear: Array
    codes: Array


def measure(
    surfaces: Sequence[Surface], truth: fields.Truth, color: Array | None, camera: Camera, frame: Frame
) -> tuple[Errors, ErrorMaps]:
    """Compare a frame with the exact answer.

    Parameters
    ----------
    surfaces : sequence of Surface
        What was rendered.
    truth : Truth
        Of `cast_truth`.
    color : (H, W, 3) float64 or None
        Exact colour of every pixel centre; None = colour is not compared.
    camera : Camera
    frame : Frame
        With depth, and with colour if `color` is given.
    """
    assert frame.depth is not None
    got = frame.depth.astype(np.float64)
    nan = np.isnan(got) | _nan_color(frame)
    length, texel = ray_lengths(camera), texel_sizes(surfaces, truth.depth, truth.owner, camera)
    clear = truth.clear(DOUBTFUL * texel)
    with np.errstate(invalid="ignore"):
        beyond = np.fmax(truth.earliest - got, got - truth.latest)
        beyond = np.where(np.isfinite(beyond), np.maximum(beyond, 0.0) * length / texel, np.nan)
    lost = np.isinf(got) & np.isfinite(truth.latest)
    extra = np.isfinite(got) & np.isinf(truth.earliest)
    both = np.isfinite(got) & np.isfinite(truth.earliest)
    astray = both & (beyond > ASTRAY)
    with np.errstate(invalid="ignore"):
        texels = np.where(both & np.isfinite(truth.depth), np.abs(got - truth.depth) * length / texel, np.nan)
    good = both & clear & ~astray
    shift, off = displacement(surfaces, truth.depth, truth.owner, camera, got, both & clear)
    codes = np.full(got.shape, np.nan)
    if color is not None and frame.color is not None:
        white = np.maximum(color[good].max(axis=-1), 1.0)
        codes[good] = 255.0 * np.abs(frame.color[good] - color[good]).max(axis=-1) / white
    errors = Errors(
        pixels=got.size,
        hits=int(np.isfinite(truth.depth).sum()),
        doubtful=int((~clear).sum()),
        lost=int(lost.sum()),
        extra=int(extra.sum()),
        astray=int(astray.sum()),
        gross=_gross(got, truth, length, texel, camera),
        nan=int(nan.sum()),
        **ends("texels", texels[both & clear]),
        **ends("shift", shift),
        **ends("off", off),
        **ends("codes", codes[good]),
        rmse=float(np.sqrt(np.mean(texels[good] ** 2))) if good.any() else 0.0,
    )
    return errors, ErrorMaps(texels, lost | extra | astray | nan, clear, codes)


def _gross(got: Array, truth: fields.Truth, length: Array, texel: Array, camera: Camera) -> int:
    """Count the pixels beyond the range of exact depths within a texel (or a pixel) around them."""
    from scipy.ndimage import maximum_filter, minimum_filter

    seen = np.isfinite(truth.depth)
    if not np.isfinite(got).any():
        return int(np.isfinite(truth.latest).sum())  # nothing is shown at all
    wide = np.median(texel[seen] * camera.K[0, 0] / truth.depth[seen]) if seen.any() else 1.0
    size = 2 * int(np.clip(np.ceil(wide), 1, REACH)) + 1
    low = minimum_filter(truth.earliest, size, mode="nearest")
    high = maximum_filter(truth.latest, size, mode="nearest")
    beyond = (np.isinf(got) & np.isfinite(high)) | (np.isfinite(got) & np.isinf(low)) | np.isnan(got)
    with np.errstate(invalid="ignore"):
        astray = np.maximum(low - got, got - high) * length / texel > ASTRAY
    return int((beyond | (np.isfinite(got) & astray)).sum())


def ray_lengths(camera: Camera) -> Array:
    """(H, W) float64: length of a pixel's ray per unit of depth along camera z."""
    rays = camera.pixel_rays(fields.pixel_centers(camera))
    return np.linalg.norm(rays, axis=1).reshape(camera.height, camera.width)


def _nan_color(frame: Frame) -> Array | bool:
    found: Any = False
    for part in (frame.color, frame.alpha):
        if part is not None:
            broken = ~np.isfinite(part)
            found = found | (broken.any(axis=-1) if part.ndim == 3 else broken)
    return found


def texel_sizes(surfaces: Sequence[Surface], depth: Array, owner: Array, camera: Camera) -> Array:
    """(H, W): size of the texel that is hit; of the first surface where nothing is."""
    out = np.full(depth.shape, max(surfaces[0].texel, 1e-300))
    for number, surface in enumerate(surfaces):
        here = owner == number
        if surface.perspective and here.any():
            start, Q_of = surface.rays(camera)
            rays = np.column_stack([fields.pixel_centers(camera), np.ones(out.size)])[here.ravel()]
            out[here] = (start[3] + depth[here] * (rays @ Q_of[3])) * surface.grain
        else:
            out[here] = surface.texel
    return out


def displacement(
    surfaces: Sequence[Surface], depth: Array, owner: Array, camera: Camera, got: Array, chosen: Array
) -> tuple[Array, Array]:
    """Return, for the `chosen` pixels, pixels and texels of depth between shown points and the surface at their texel.

    `depth` and `owner` are those of the exact hits.

    Neither is more than the distance along the ray says: on cliffs that is the better measure.
    """
    shift, off = np.full(got.shape, np.nan), np.full(got.shape, np.nan)
    rays = camera.pixel_rays(fields.pixel_centers(camera))
    for number, surface in enumerate(surfaces):
        here = (chosen & (owner == number)).ravel()
        if not here.any():
            continue
        points = camera.center + got.ravel()[here, None] * rays[here]
        x, y, n, q = surface.place(points).T
        u, v, d = x / q, y / q, n / q
        value = np.empty(len(u))
        rows, columns = surface.shape
        kernels.values_at(u, v, d, surface.starts, columns, rows, surface.corners, surface.masks, value)
        along = np.abs(got.ravel()[here] - depth.ravel()[here]) * np.linalg.norm(rays[here], axis=1)
        texel = texel_sizes(surfaces, depth, owner, camera).ravel()[here]
        away = np.abs(d - value) / (surface.grain * (np.abs(value) if surface.perspective else 1.0))
        off.ravel()[here] = np.fmin(away, along / texel)
        near = np.maximum(np.fmin(got, depth).ravel()[here], 1e-300)
        shift.ravel()[here] = np.fmin(_moved(camera, points, surface.world(u, v, value)), along * camera.K[0, 0] / near)
    return shift[chosen], off[chosen]


def _moved(camera: Camera, shown: Array, belongs: Array) -> Array:
    """Pixels between the projections of two sets of points (N, 3); NaN where one is not in front of the camera."""
    places = []
    for points in (shown, belongs):
        x, y, z = (camera.K @ camera.R) @ (points - camera.center).T
        with np.errstate(divide="ignore", invalid="ignore"):
            places.append(np.where(z > 0, np.stack([x / z, y / z]), np.nan))
    return np.hypot(*(places[1] - places[0]))


def ends(name: str, values: Array) -> dict[str, float]:
    """Return the largest and 99th percentile of the finite values; 0 where there are none."""
    values = values[np.isfinite(values)]
    if not len(values):
        return {name: 0.0, f"{name}_p99": 0.0}
    return {name: float(values.max()), f"{name}_p99": float(np.percentile(values, 99))}
