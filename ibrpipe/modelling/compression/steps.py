"""Steps of coding from exact to coarse, and the coarsest of them that still keeps a promise, found by bisection."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from ibrpipe.io.layer_pictures import LOSSLESS, Coding

#: bits of a coordinate of normals that depth does not give well enough, such as those that mirror
_KEPT_BITS = 8


@dataclass(frozen=True)
class CodingStep:
    """One way to code an asset.

    Attributes
    ----------
    layers : Coding
        Of the layers.
    components : int or None
        Quality of view dependence, 1 to 99; None = its files are kept as they are.
    """

    layers: Coding
    components: int | None = None


#: degrees; a twentieth per cent of the normals of a mesh's layers differ more from what depth gives
_TOLERANCE = 15.0


def _step(color: int | None, depth: float, bits: int, components: int | None = None) -> CodingStep:
    coding = Coding(color_quality=color, depth_step=depth, normal_bits=bits, normal_tolerance=_TOLERANCE)
    return CodingStep(coding, components)


#: from exact to coarse; the components' pictures cost most and pay least, so they are coarsened before the colours
STEPS = (
    CodingStep(LOSSLESS),
    _step(None, 1 / 16, 8),
    _step(99, 1 / 8, 7),
    _step(98, 1 / 4, 6),
    _step(97, 1 / 4, 6),
    _step(97, 1 / 4, 6, 85),
    _step(96, 1 / 4, 6, 75),
    _step(95, 1 / 4, 6, 60),
    _step(93, 1 / 4, 6, 40),
    _step(90, 1 / 2, 5, 25),
    _step(85, 1 / 2, 5, 12),
    _step(75, 1 / 2, 5, 6),
    _step(60, 1.0, 5, 3),
    _step(40, 1.0, 4, 1),
)


#: normals alone had from depth: what that costs says whether it may be done
NORMALS = CodingStep(Coding(normal_bits=8, normal_tolerance=_TOLERANCE))


def keep_normals(step: CodingStep) -> CodingStep:
    """Return the step with normals of their own where it has them from depth."""
    if step.layers.normal_tolerance is None:
        return step
    return CodingStep(
        step.layers.model_copy(update={"normal_tolerance": None, "normal_bits": _KEPT_BITS}), step.components
    )


def coarsest(count: int, kept: Callable[[int], bool]) -> int | None:
    """Return the last of `count` steps that keeps a promise, which finer ones keep too; None = not even the first.

    The promise of a step is asked for once at most, and of about log2(count) steps.
    """
    low, high = -1, count
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if kept(middle) else (low, middle)
    return None if low < 0 else low


def finest(count: int, kept: Callable[[int], bool]) -> int | None:
    """Return the first of `count` steps that keeps a promise, which coarser ones keep too; None = not even the last."""
    found = coarsest(count, lambda step: not kept(step))
    first = 0 if found is None else found + 1
    return None if first == count else first
