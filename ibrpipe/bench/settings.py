"""Which settings of which renderer take part, and what each of them promises.

A renderer joins by being registered: without an entry here it takes part with its defaults and is held to `EXACT`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

from ibrpipe.errors import ConfigError
from ibrpipe.renderers.registry import AnyRenderer, registered
from ibrpipe.types import Scene
from ibrpipe.types.prerendered import PrerenderedScene


@dataclass(frozen=True)
class Limit:
    """What a cell of the table of hard cases may show at most.

    Attributes
    ----------
    texels : float
        Largest distance along the ray; the rounding of float32 depth is added.
    texels_p99, shift_p99 : float
        99th percentiles along the ray in texels, and in pixels.
    wrong, gross : float
        Share of the pixels that may be lost, extra or astray; and of those that a shift by a texel does not excuse.
    codes_p99 : float
        99th percentile of the colour's error in 8-bit codes.
    reason : str
        Why the limit is what it is.
    coverage, leak : float
        Of scenes of copies: by what share the covered area may err, and what may be seen through whole pixels.
    """

    texels: float
    texels_p99: float
    shift_p99: float
    wrong: float
    gross: float
    codes_p99: float
    reason: str
    coverage: float = float("inf")
    leak: float = float("inf")


ANY = float("inf")
EXACT = Limit(
    2e-3, 1e-3, 1e-2, 0.0, 0.0, 0.6, "exact search: only the rounding of stored and returned numbers is allowed"
)


@dataclass(frozen=True)
class Setting:
    """One renderer with some options.

    Attributes
    ----------
    renderer : str
    label : str
        Name in tables, unique.
    options : mapping
    limit : Limit
        For every case that `special` does not name.
    special : mapping
        Limits by the name of a case, or by the beginning of its name.
    first_layer : bool
        Only the first sample of each texel is shown.
    refuses : str
        Why it may refuse sources of a kind that it accepts; empty = it must not.
    quick : bool
        Takes part in the quick preset of ``speed-error``.
    only : str
        "meshes" or "scenes": takes part in the hard cases of relief-mapped meshes, or of scenes of copies, alone.
    hard : bool
        Takes part in the hard cases; without, only in ``speed-error``: it is meant to be coarser.
    """

    renderer: str
    label: str
    options: Mapping[str, Any] = field(default_factory=dict)
    limit: Limit = EXACT
    special: Mapping[str, Limit] = field(default_factory=dict)
    first_layer: bool = False
    refuses: str = ""
    quick: bool = True
    only: Literal["", "meshes", "scenes"] = ""
    hard: bool = True

    def limit_for(self, case: str) -> Limit:
        """Return the limit of a case: the longest entry of `special` that its name begins with, else `limit`."""
        fitting = [name for name in self.special if case.startswith(name)]
        return self.special[max(fitting, key=len)] if fitting else self.limit


SAMPLED = Limit(
    ANY, ANY, 4.0, 0.12, 2e-3, ANY,
    "resampled along rows, then columns: what lies at silhouettes and steps is right to about a texel",
)  # fmt: skip
TOUCHED = {
    "eye-on-texel": Limit(ANY, ANY, ANY, 0.2, 2e-3, ANY, "resampled; the texel that the eye touches fills the view")
}
STEEP = {
    "surface-steep-step": Limit(
        ANY, ANY, ANY, 0.12, 0.03, ANY, "resampled; a cliff of ten thousand texels within one texel"
    )
}
CLIFF = {
    "surface-steep-step": Limit(
        ANY, ANY, ANY, 0.14, 0.03, ANY, "averaged over pixels; a cliff of ten thousand texels within one texel"
    )
}

#: layered images end half a texel beyond their outermost samples; height fields at them
NO_RIM = "; layered images as height fields of their first layer, without the rim of half a texel"
RIM = Limit(2e-3, 1e-3, 1e-2, 0.06, 2e-3, 0.6, EXACT.reason + NO_RIM)
RIMS = dict.fromkeys(("layers-", "bits-layers", *(f"size-{n}-layers" for n in ("33x5", "7x13"))), RIM) | dict.fromkeys(
    (f"size-{n}-layers" for n in ("1x1", "9x1", "1x9", "2x2")), Limit(2e-3, 1e-3, 1e-2, 0.12, ANY, 0.6, RIM.reason)
)
STEPS = Limit(
    ANY, ANY, 8.0, 0.16, 0.05, ANY,
    "published search: features thinner than a step are missed, and what is below the surface where it enters is hit",
)  # fmt: skip
FLATS = {
    "surface-constant": Limit(ANY, ANY, ANY, 1.0, 1.0, ANY, "published search: a box without thickness holds no step"),
    "eye-on-texel": Limit(ANY, ANY, ANY, 0.16, 0.05, ANY, "published search: a step is a large shift close to the eye"),
}
MESH_STEPS = {
    "mesh-": Limit(ANY, ANY, ANY, 0.16, 0.16, ANY, STEPS.reason),
    "mesh-dual-thin": Limit(ANY, ANY, ANY, 0.55, 0.55, ANY, "published search: a wall thinner than a step is missed"),
}

LINES = Limit(
    ANY, ANY, ANY, 0.2, 0.02, ANY,
    "reference samples met step by step along an epipolar line: right to about a texel, thin features are missed",
)  # fmt: skip

NEAREST = {
    "surface-steep-step": Limit(
        ANY, ANY, ANY, 0.2, 0.18, ANY,
        LINES.reason + "; a cliff of ten thousand texels, which 18 % of the pixels see, is shown at either end",
    ),
    "surface-one-texel-islands": Limit(
        ANY, ANY, ANY, 0.2, 0.2, ANY,
        LINES.reason + "; lone samples are shown as texels, though the surface begins with four together",
    ),
}  # fmt: skip

SPLATS = Limit(
    ANY, ANY, ANY, ANY, ANY, ANY,
    "forward-warp baseline: holes where samples are far apart, boundless footprints near the eye; only NaN counts",
)  # fmt: skip

PREFILTERED = Limit(
    ANY, 8.0, ANY, 0.0, ANY, 11.0,
    "prefiltered slices, drawn where their outlines are: what is seen inside these is nearer and shifts, by up to 11 "
    "codes; seen up to 11 degrees beside their direction they are 1 % narrower, sheared ones wider", 0.02, 0.01,
)  # fmt: skip
SAMPLES = Limit(
    ANY, ANY, ANY, 0.02, ANY, ANY, "as published: one sample a texel, drawn as a square, opaque; edges are aliased"
)  # fmt: skip
POLYGONS = Limit(
    ANY, 3.0, ANY, 0.0, ANY, 10.0, "16 samples a pixel where the oracle has 64 or more: 2 codes inside, 10 at edges",
    0.01, 0.001,
)  # fmt: skip
FEW_SAMPLES = Limit(
    ANY, 3.0, ANY, 0.0, ANY, 10.0, "16 samples a pixel on a grid: what is thinner than their distance is hit by chance",
    0.05, 0.001,
)  # fmt: skip
OF_SLICES = {
    "copies-coincident": Limit(
        ANY, 8.0, ANY, 0.0, ANY, 10.0,
        "what covers a pixel in part hides what is behind by chance: five copies in one place cover more than one",
        0.5, 0.01,
    ),
    "copies-outline": Limit(
        ANY, 8.0, ANY, 0.0, ANY, 14.0, "two slabs: both cover some of the pixels at the outline", 0.03, 0.01
    ),
    "copies-wires": Limit(ANY, ANY, ANY, 0.0, ANY, ANY, "prefiltered: thin things cover their share", 0.01, 0.01),
}  # fmt: skip

SETTINGS: tuple[Setting, ...] = (
    Setting("ldi", "ldi"),
    Setting("ldi", "ldi patches", {"search": "patches"}, quick=False),
    Setting("ldi", "ldi quadtree", {"search": "quadtree"}, quick=False),
    Setting("epipolar", "epipolar", {"search": "exact"}),
    Setting("epipolar", "epipolar nearest", {"search": "nearest"}, LINES, NEAREST, first_layer=True),
    Setting("epipolar", "epipolar linear", {"search": "linear"}, LINES, first_layer=True, quick=False),
    Setting("splat", "splat", {}, SPLATS, first_layer=True, quick=False),
    Setting("splat", "splat 2 texels", {"footprint": 2.0}, quick=False, hard=False),
    Setting("relief", "relief", {"search": "exact"}, special=RIMS, first_layer=True),
    Setting("relief", "relief 32+8", {"search": "linear-binary"}, STEPS, FLATS | MESH_STEPS, first_layer=True),
    Setting(
        "relief",
        "relief 64+8",
        {"search": "linear-binary", "linear_steps": 64},
        first_layer=True,
        quick=False,
        hard=False,
    ),
    Setting(
        "relief",
        "relief 256+8",
        {"search": "linear-binary", "linear_steps": 256},
        STEPS,
        FLATS | MESH_STEPS,
        True,
        quick=False,
    ),
    Setting("relief", "relief shell", {"model": "shell"}, only="meshes"),
    Setting("prewarp", "prewarp", {"method": "two-pass"}, SAMPLED, TOUCHED | STEEP, first_layer=True),
    Setting("prewarp", "prewarp pipelined", {"method": "pipelined"}, SAMPLED, TOUCHED | STEEP, first_layer=True),
    Setting("prewarp", "prewarp area", {"filter": "area"}, SAMPLED, TOUCHED | CLIFF, first_layer=True, quick=False),
    Setting("prewarp", "prewarp 8-bit", {"depth_bits": 8}, SAMPLED, TOUCHED | STEEP, first_layer=True, quick=False),
    Setting("prewarp", "prewarp level 1", {"level": 1}, quick=False, hard=False),
    Setting("prewarp", "prewarp parted", {"max_step": 4.0}, quick=False, hard=False),
    Setting("hierarchical", "hierarchical", {}, PREFILTERED, OF_SLICES, only="scenes"),
    Setting("hierarchical", "hierarchical reproject", {"mode": "reproject"}, SAMPLES, only="scenes"),
    Setting(
        "hierarchical",
        "hierarchical polygons",
        {"mode": "polygons"},
        POLYGONS,
        dict.fromkeys(("copies-one-texel", "copies-wires"), FEW_SAMPLES),
        only="scenes",
    ),
)


def choose_settings(renderers: Sequence[str] = (), speed: bool = False) -> list[Setting]:
    """Return the settings of the registered renderers, or of those named; with `speed`, those that are coarser too.

    Raises
    ------
    ConfigError
        A name is neither a renderer nor a setting.
    """
    known = registered()
    found = [
        each
        for each in SETTINGS
        if each.renderer in known
        and set(each.options) <= set(known[each.renderer].Options.model_fields)
        and (each.hard or speed)
    ]
    named = {each.renderer for each in found}
    found += [Setting(name, name) for name in known if name not in named and _takes_textures(known[name])]
    for name in renderers:
        if name not in known and name not in {each.label for each in found}:
            raise ConfigError(f"there is no renderer or setting {name!r}; choose among: {', '.join(_names(found))}")
    if renderers:
        found = [each for each in found if each.renderer in renderers or each.label in renderers]
    return found


def _takes_textures(renderer: AnyRenderer) -> bool:
    """Whether a renderer can be given what the bench has: scenes of copies have a bench of their own."""
    return any(each not in (Scene, PrerenderedScene) for each in renderer.accepts)


def _names(settings: Sequence[Setting]) -> list[str]:
    return sorted({each.renderer for each in settings} | {each.label for each in settings})
