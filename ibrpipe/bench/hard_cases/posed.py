"""A shot stored in some bits of depth: its exact answers, and the limits that follow from what storing rounds."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from functools import cached_property

import numpy as np

from ibrpipe.bench.cases import Shot
from ibrpipe.bench.hard_cases.results import Figures, Limits
from ibrpipe.bench.oracles import fields
from ibrpipe.bench.oracles.surface import Surface, first_layer
from ibrpipe.bench.settings import Limit
from ibrpipe.bench.speed_error.measure import Errors, displacement, ray_lengths
from ibrpipe.types import Array, Camera, Frame, LayeredDepthImage
from ibrpipe.types.renderable import GridSource

#: units in the last place of float32 depth that every renderer may add
ULPS = 4
#: texels of rounding from which colour may change with it; texels from the eye within which that of heights is seen
COARSE, NEAR = 1e-2, 1e-1


@dataclass(frozen=True, eq=False)
class Posed:
    """A shot stored in some bits, with its exact answers, shared by all settings."""

    shot: Shot
    bits: int
    step: float
    original: Shot

    @cached_property
    def all_layers(self) -> tuple[Surface, fields.Truth, Array]:
        """Return surface, exact hits and exact colours of the whole source."""
        return _solved(self.shot.surface(), self.shot.camera)

    @cached_property
    def one_layer(self) -> tuple[Surface, fields.Truth, Array]:
        """Return the same of the first layer alone."""
        if not isinstance(self.shot.source, LayeredDepthImage):
            return self.all_layers
        return _solved(Shot(first_layer(self.shot.source), self.shot.camera).surface(), self.shot.camera)

    @cached_property
    def meant(self) -> tuple[Surface, Array]:
        """The surface before it was stored, and its exact depths."""
        surface, camera = self.original.meant(), self.shot.camera
        depth = fields.cast([surface], camera, fields.pixel_centers(camera))[0]
        return surface, depth.reshape(camera.height, camera.width)


def _solved(surface: Surface, camera: Camera) -> tuple[Surface, fields.Truth, Array]:
    truth = fields.cast_truth([surface], camera)
    hits = (truth.depth.ravel(), truth.patch.ravel(), truth.owner.ravel())
    color, _ = fields.colors_at([surface], camera, fields.pixel_centers(camera), hits)
    return surface, truth, color.reshape(*truth.depth.shape, 3)


def seen(shot: Shot) -> bool:
    """Tell whether any pixel sees the surface."""
    return bool(np.isfinite(fields.cast([shot.surface()], shot.camera, fields.pixel_centers(shot.camera))[0]).any())


def count_samples(source: GridSource) -> int:
    """Return the number of stored depths."""
    return int((source.height if hasattr(source, "height") else source.depth).size)  # type: ignore[union-attr]


def from_meant(posed: Posed, surface: Surface, truth: fields.Truth, frame: Frame) -> tuple[float, float] | None:
    """Largest and 99th-percentile distance in depth from the surface before storing, over right hits; in texels."""
    if surface.front and posed.bits != 32:
        return None  # coarser depths may connect other samples: another surface, not an error of depth
    assert frame.depth is not None
    got = frame.depth.astype(np.float64)
    camera = posed.shot.camera
    with np.errstate(invalid="ignore"):
        close = np.abs(got - truth.depth) * ray_lengths(camera) <= surface.texel
    right = np.isfinite(got) & np.isfinite(truth.depth) & close & truth.clear(1e-3 * surface.texel)
    meant, depth = (surface, truth.depth) if surface.front else posed.meant
    _, off = displacement([meant], depth, truth.owner, camera, got, right)
    off = off[np.isfinite(off)]
    return (float(off.max()), float(np.percentile(off, 99))) if len(off) else (0.0, 0.0)


def hold_limits(limit: Limit, posed: Posed, surface: Surface, truth: fields.Truth, colors_tie: str) -> Limits:
    """Return the limit with what float32 depth and the steps of stored depth add."""
    seen = truth.depth[np.isfinite(truth.depth)]
    far = float(seen.max()) if len(seen) else 0.0
    lengths = ray_lengths(posed.shot.camera)
    rounding = ULPS * float(np.spacing(np.float32(far))) * float(lengths.max()) / max(surface.texel, 1e-300)
    stored = 0.5 * posed.step / surface.texel + ULPS * _stored_rounding(posed, surface)
    shift = rounding * surface.texel * posed.shot.camera.K[0, 0] / max(far, 1e-300)
    codes, reasons = 0.0, [limit.reason]
    if rounding > COARSE:
        codes = _color_rounding(posed, surface, truth)
        reasons.append(
            f"float32 depth is {rounding / ULPS:.2g} texels coarse so far away, and colour is looked up at it"
        )
    if len(seen) and float(np.percentile(seen, 1)) < NEAR * surface.texel:
        shift += _height_rounding(posed, surface, seen)
        reasons.append("so close to the eye the last place of float32 heights is seen")
    return Limits(
        texels=finite(limit.texels + rounding),
        texels_p99=finite(limit.texels_p99 + rounding),
        shift_p99=finite(limit.shift_p99 + shift),
        wrong=finite(limit.wrong),
        gross=finite(limit.gross),
        codes_p99=None if colors_tie else finite(limit.codes_p99 + codes),
        meant=finite(limit.texels + rounding + stored),
        reason="; ".join([*reasons, colors_tie] if colors_tie else reasons),
    )


def _color_rounding(posed: Posed, surface: Surface, truth: fields.Truth) -> float:
    """99th percentile of the change of exact colour, 8-bit codes, when depth is rounded to float32."""
    camera, depth = posed.shot.camera, truth.depth.ravel()
    grid, shown = fields.pixel_centers(camera), np.isfinite(depth)

    def color(moved: Array) -> Array:
        return fields.colors_at([surface], camera, grid, (moved, truth.patch.ravel(), truth.owner.ravel()))[0][shown]

    ulp = np.where(shown, np.spacing(np.where(shown, depth, 0.0).astype(np.float32)), 0.0)
    exact = color(depth)
    change = np.stack([np.abs(color(depth + share * ulp) - exact).max(axis=-1) for share in (-0.51, 0.51)])
    return float(np.percentile(255.0 * change.max(axis=0) / np.maximum(exact.max(axis=-1), 1.0), 99))


def _height_rounding(posed: Posed, surface: Surface, seen: Array) -> float:
    """99th percentile of the pixels by which a unit in the last place of the stored heights is seen."""
    unit = _stored_rounding(posed, surface) * surface.texel
    return float(np.percentile(unit * posed.shot.camera.K[0, 0] / seen, 99))


def _stored_rounding(posed: Posed, surface: Surface) -> float:
    """Texels of depth by which float32 may round the largest stored depth."""
    depth = posed.shot.source.height if hasattr(posed.shot.source, "height") else posed.shot.source.depth  # type: ignore[union-attr]
    some = np.abs(depth[np.isfinite(depth)])
    return float(np.spacing(np.float32(some.max()))) / surface.texel if len(some) and not surface.perspective else 1e-3


def exceed(errors: Errors, meant: tuple[float, float] | None, limits: Limits) -> list[str]:
    """Return what is beyond its limit, in words."""
    found = []
    if errors.nan:
        found.append(f"{errors.nan} pixels hold NaN")
    wrong = errors.wrong / max(errors.pixels, 1)
    if limits.wrong is not None and wrong > limits.wrong:
        parts = f"{errors.lost} lost, {errors.extra} extra, {errors.astray} astray"
        found.append(f"{errors.wrong} of {errors.pixels} pixels wrong ({parts}); at most {limits.wrong:.2%}")
    if limits.gross is not None and errors.gross / max(errors.pixels, 1) > limits.gross:
        found.append(
            f"{errors.gross} of {errors.pixels} wrong by more than a texel's shift; at most {limits.gross:.2%}"
        )
    named = {
        "texels": (errors.texels, "texels along the ray at worst"),
        "texels_p99": (errors.texels_p99, "texels along the ray (99th percentile)"),
        "shift_p99": (errors.shift_p99, "pixels (99th percentile)"),
        "codes_p99": (errors.codes_p99, "codes of colour (99th percentile)"),
    }
    if meant is not None:
        named["meant"] = (meant[0], "texels from the surface before it was stored")
    for name, (value, words) in named.items():
        most = getattr(limits, name)
        if most is not None and not value <= most:
            found.append(f"{value:.3g} {words}; at most {most:.3g}")
    return found


def figures_of(errors: Errors, meant: tuple[float, float] | None) -> Figures:
    """Return the errors as the results hold them."""
    values = {name: value if isinstance(value, int) else finite(value) for name, value in asdict(errors).items()}
    return Figures(**values, meant=meant[0] if meant else None, meant_p99=meant[1] if meant else None)


def finite(value: float) -> float | None:
    """Return the value; None where it is infinite or NaN."""
    return value if math.isfinite(value) else None
