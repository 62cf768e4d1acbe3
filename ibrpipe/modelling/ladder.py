"""Which rung of the ladder a capture needs: diffuse colours, shared reflection, or spiral images.

Rungs are compared on photos that were left out, in dB of the whole asset. A rung is taken when it buys enough: more
error for little data first, images per direction only where nothing smaller explains the photos.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from ibrpipe.io.documents.plan import PlannedComponent
from ibrpipe.modelling.plan_file import TexturePlan, Told, reason
from ibrpipe.modelling.trial import LUMIGRAPH, MEDIAN, SHARPENED, TABLES, Trial, decibel
from ibrpipe.modelling.view_dependence.spiral_images import spiral_images
from ibrpipe.types import Reflection

#: what a spiral loses against the lumigraph of the four best photos by its texels and its coding, dB
SPIRAL_LOSS = 0.3
#: bytes of a texel of a spiral image, of a sample's table weights, of a table
PER_TEXEL, PER_WEIGHT, PER_TABLE = 0.04, 1.0, 4000
#: gain from which on another way to fit diffuse colours is taken, dB
DIFFUSE_STEP = 0.05


@dataclass(frozen=True)
class Prices:
    """What a rung must buy: dB of the asset, and dB of the asset for a megabyte."""

    least: float
    per_megabyte: float


def climb(
    trial: Trial, plans: Sequence[TexturePlan], spacing: float, prices: Prices
) -> tuple[list[tuple[PlannedComponent, ...]], list[Told]]:
    """Decide what every texture gets.

    Parameters
    ----------
    plans : those that left-out photos ask to be view-dependent hold a spiral
    spacing : angle between photos, degrees

    Returns
    -------
    components : what is modelled on every texture
    reasons : one for every rung: its choice, dB, bytes and the rule
    """
    told, joint = _diffuse(trial)
    tables, mirror = _reflection(trial, plans, spacing, prices)
    spirals, why = _spirals(trial, plans, spacing, prices, bool(tables))
    told += [mirror, why]
    if tables:
        shared = PlannedComponent(kind=Reflection.kind, tables=tables)
        return [(shared,) for _ in plans], told
    if any(spirals):
        return [plan.components if taken else () for plan, taken in zip(plans, spirals, strict=True)], told
    matt = PlannedComponent(kind=Reflection.kind, tables=0)
    return [(matt,) if joint else () for _ in plans], told


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


def _spirals(
    trial: Trial, plans: Sequence[TexturePlan], spacing: float, prices: Prices, mirrored: bool
) -> tuple[list[bool], Told]:
    """Choose the textures that get images per direction."""
    what, wanted = "rung 3: images per direction", [bool(plan.components) for plan in plans]
    if mirrored or not any(wanted):
        why = "the rung before explains the photos with less data" if mirrored else "no texture changes with the view"
        return [False] * len(plans), reason(what, "dropped", why, textures=0)
    matt = min((trial.squares[name] for name in (MEDIAN, TABLES[0])), key=trial.mean)
    better = trial.squares[LUMIGRAPH] * trial.lumigraph_at(spacing) * 10 ** (0.1 * SPIRAL_LOSS)
    mended, size = matt.copy(), 0.0
    for which, plan in enumerate(plans):
        if wanted[which]:
            mended[which] = min(better[which], matt[which])
            size += PER_TEXEL * sum(image.texels for image in spiral_images(plan, True)[1])
    gain = decibel(trial.mean(mended)) - decibel(trial.mean(matt))
    pays = _pays(gain, size, prices)
    figures = {"psnr": round(decibel(trial.mean(mended)), 2), "gain_db": round(gain, 2), "bytes": round(size)}
    why = (
        f"{sum(wanted)} textures would bring the asset {gain:.2f} dB for about {size / 1e6:.2f} MB; a rung is taken "
        f"when it brings {prices.least} dB and {prices.per_megabyte} dB for a megabyte"
    )
    chosen = [each and pays for each in wanted]
    return chosen, reason(what, "taken" if pays else "dropped", why, textures=sum(chosen), **figures)


def _pays(gain: float, size: float, prices: Prices) -> bool:
    return gain >= max(prices.least, prices.per_megabyte * size / 1e6)
