"""Which rung of the ladder a capture needs: diffuse colours, shared reflection, or images per direction.

Rungs are compared on photos that were left out, in dB of the whole asset. A rung is taken when it buys enough: more
error for little data first, images per direction only where nothing smaller explains the photos. Those are the photos
themselves, or images on spiral directions, where the photos are so many that a spiral is smaller.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from ibrpipe.io.documents.plan import PlannedComponent
from ibrpipe.modelling.plan_file import TexturePlan, Told, reason
from ibrpipe.modelling.trial import LUMIGRAPH, MEDIAN, SHARPENED, TABLES, Trial, decibel
from ibrpipe.modelling.view_dependence.spiral_images import spiral_images
from ibrpipe.modelling.view_dependence.spiral_plan import SPIRAL
from ibrpipe.types import Array, PhotoBlend, Reflection

#: what a spiral loses against the lumigraph of the four best photos by its texels and its coding, dB, and kept photos
SPIRAL_LOSS, PHOTOS_LOSS = 0.3, 0.1
#: bytes of a texel of a spiral image, of a photo's pixel, of a sample's table weights, of a table
PER_TEXEL, PER_PIXEL, PER_WEIGHT, PER_TABLE = 0.04, 0.04, 1.0, 4000
#: gain from which on another way to fit diffuse colours is taken, dB
DIFFUSE_STEP = 0.05


@dataclass(frozen=True)
class Prices:
    """What a rung must buy: dB of the asset, and dB of the asset for a megabyte."""

    least: float
    per_megabyte: float


@dataclass(frozen=True)
class Directions:
    """What may hold images per direction: `kind` "spiral" or "photos", or "auto", and bytes that photos would take."""

    kind: Literal["auto", "spiral", "photos"]
    photo_bytes: float

    def allows(self, kind: str) -> bool:
        """Say whether images per direction may be of a kind."""
        return self.kind in ("auto", kind)


def climb(
    trial: Trial, plans: Sequence[TexturePlan], spacing: float, prices: Prices, directions: Directions
) -> tuple[list[tuple[PlannedComponent, ...]], list[Told]]:
    """Decide what every texture gets.

    Parameters
    ----------
    plans : those that left-out photos ask to be view-dependent hold a spiral
    spacing : angle between photos, degrees
    directions : what may hold images per direction

    Returns
    -------
    components : what is modelled on every texture
    reasons : one for every rung: its choice, dB, bytes and the rule
    """
    told, joint = _diffuse(trial)
    tables, mirror = _reflection(trial, plans, spacing, prices)
    images, why = _images(trial, plans, spacing, prices, directions, "rung 2" if tables else None)
    told += [mirror, why]
    if tables:
        shared = PlannedComponent(kind=Reflection.kind, tables=tables)
        return [(shared,) for _ in plans], told
    if images == SPIRAL:
        return [plan.components for plan in plans], told
    matt = (PlannedComponent(kind=Reflection.kind, tables=0),) if joint else ()
    photos = (PlannedComponent(kind=PhotoBlend.kind),) if images == PhotoBlend.kind else ()
    return [(*matt, *photos) for _ in plans], told


def _diffuse(trial: Trial) -> tuple[list[Told], bool]:
    """Compare the joint fit of diffuse colours with the median of photos, sharpened where that was tried."""
    before = max(trial.psnr_everywhere(name) for name in (MEDIAN, SHARPENED) if name in trial.everywhere)
    found = trial.psnr_everywhere(TABLES[0])
    joint = found >= before + DIFFUSE_STEP
    how = "the median of photos, sharpened" if SHARPENED in trial.squares else "the median of photos"
    why = (
        f"colours fitted to all photos at once predict left-out photos to {found:.2f} dB, {how}, to {before:.2f}; "
        f"they are taken from {DIFFUSE_STEP} dB more on where nothing changes with the view"
    )
    return [reason("rung 1: diffuse colours", "joint fit" if joint else how, why, psnr=round(found, 2), bytes=0)], joint


def _reflection(trial: Trial, plans: Sequence[TexturePlan], spacing: float, prices: Prices) -> tuple[int, Told]:
    """Choose the number of tables of reflected light, 0 = none."""
    if not any(plan.components for plan in plans):
        return 0, reason("rung 2: shared reflection", "dropped", "no texture changes with the view", tables=0)
    tables = trial.best_tables()
    matt = max(trial.psnr(name) for name in (MEDIAN, SHARPENED, TABLES[0]) if name in trial.squares)
    tried = tables or 1
    found = trial.psnr(TABLES[tried])
    samples = sum(plan.rectangle.width * plan.rectangle.height for plan in plans)
    size = tried * PER_TABLE + (PER_WEIGHT * samples * tried if tried > 1 else 0.0)
    lumigraph = decibel(trial.mean(trial.squares[LUMIGRAPH]) * trial.lumigraph_at(spacing)) - SPIRAL_LOSS
    figures = {"psnr": round(found, 2), "gain_db": round(found - matt, 2), "bytes": round(size)}
    figures |= {"spiral_psnr": round(lumigraph, 2), "lumigraph_psnr": round(trial.psnr(LUMIGRAPH), 2)}
    what = "rung 2: shared reflection"
    gains = f"{tried} table{'s' * (tried > 1)} of reflected light predict left-out photos to {found:.2f} dB"
    if tables == 0 or not _pays(found - matt, size, prices):
        why = f"{gains}, diffuse colours to {matt:.2f}; {prices.least} dB more are asked for"
        return 0, reason(what, "dropped", why, **figures)
    if found < lumigraph:
        why = (
            f"{gains}, but images per direction are expected to reach {lumigraph:.2f}: the gloss is of a kind that "
            f"tables cannot say, or the surface is not exact enough to mirror"
        )
        return 0, reason(what, "dropped", why, **figures)
    why = f"{gains}, diffuse colours to {matt:.2f}, images per direction would reach about {lumigraph:.2f}"
    return tables, reason(what, f"taken, {tables} table{'s' * (tables > 1)}", why, **figures)


def _images(
    trial: Trial,
    plans: Sequence[TexturePlan],
    spacing: float,
    prices: Prices,
    directions: Directions,
    before: str | None,
) -> tuple[str | None, Told]:
    """Choose what holds images per direction, None = nothing; `before` names a rung that explains the photos."""
    what, wanted = "rung 3: images per direction", [bool(plan.components) for plan in plans]
    if before is not None or not any(wanted):
        why = f"{before} explains the photos with less data" if before else "no texture changes with the view"
        return None, reason(what, "dropped", why, textures=0)
    matt = min((trial.squares[name] for name in (MEDIAN, TABLES[0])), key=trial.mean)
    lumigraph = trial.squares[LUMIGRAPH] * trial.lumigraph_at(spacing)
    spiral = _mended(matt, lumigraph * 10 ** (0.1 * SPIRAL_LOSS), wanted)
    photos = _mended(matt, lumigraph * 10 ** (0.1 * PHOTOS_LOSS), [True] * len(plans))
    offers = {SPIRAL: (spiral, spiral_bytes(plans)), PhotoBlend.kind: (photos, directions.photo_bytes)}
    gains = {
        kind: (decibel(trial.mean(mended)) - decibel(trial.mean(matt)), size)
        for kind, (mended, size) in offers.items()
        if directions.allows(kind)
    }
    kind = max(gains, key=lambda each: gains[each][0] - prices.per_megabyte * gains[each][1] / 1e6)
    gain, size = gains[kind]
    pays = _pays(gain, size, prices)
    told = ", ".join(
        f"{_WORDS[each]} {more:.2f} dB for about {cost / 1e6:.2f} MB" for each, (more, cost) in gains.items()
    )
    figures = {"psnr": round(decibel(trial.mean(matt)) + gain, 2), "gain_db": round(gain, 2), "bytes": round(size)}
    why = (
        f"{sum(wanted)} textures change with the view; would bring the asset: {told}; a rung is taken "
        f"when it brings {prices.least} dB and {prices.per_megabyte} dB for a megabyte"
    )
    taken = sum(wanted) if kind == SPIRAL else len(plans)
    choice = f"taken, {_WORDS[kind]}" if pays else "dropped"
    return kind if pays else None, reason(what, choice, why, textures=taken if pays else 0, **figures)


def untried(plans: Sequence[TexturePlan], directions: Directions) -> list[TexturePlan]:
    """Return plans whose images per direction, where they want some, take the fewest bytes."""
    smaller = directions.kind == SPIRAL or (directions.kind == "auto" and spiral_bytes(plans) <= directions.photo_bytes)
    if smaller or not any(plan.component(SPIRAL) for plan in plans):
        return list(plans)
    photos = PlannedComponent(kind=PhotoBlend.kind)
    return [replace(plan, components=(*plan.components, photos)) for plan in without_spirals(plans)]


def without_spirals(plans: Sequence[TexturePlan]) -> list[TexturePlan]:
    """Return plans without images on spiral directions, which photos would hide."""
    return [replace(plan, components=tuple(each for each in plan.components if each.kind != SPIRAL)) for plan in plans]


#: kinds of images per direction in words
_WORDS = {SPIRAL: "spiral images", PhotoBlend.kind: "photos that are kept"}


def _mended(matt: Array, better: Array, wanted: Sequence[bool]) -> Array:
    """Mean squares (T,) where what is better replaces diffuse colours on the textures that want it."""
    return np.where(wanted, np.minimum(better, matt), matt)


def spiral_bytes(plans: Sequence[TexturePlan]) -> float:
    """Bytes that the spiral images of all textures that want them are expected to take."""
    own = [plan for plan in plans if plan.component(SPIRAL)]
    return PER_TEXEL * sum(image.texels for plan in own for image in spiral_images(plan, True)[1])


def _pays(gain: float, size: float, prices: Prices) -> bool:
    return gain >= max(prices.least, prices.per_megabyte * size / 1e6)
