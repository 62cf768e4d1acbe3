"""The verdict in words, and how figures are written."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ibrpipe.evaluation.metrics import MetricsModel, Scores

NONE = "–"
MINUS = "−"


@dataclass(frozen=True)
class Card:
    """One headline figure; `tone` is "good", "fair", "poor" or "plain"."""

    label: str
    value: str
    note: str
    tone: str = "plain"


def number(value: float | None, digits: int) -> str:
    """Write a figure with a fixed number of decimals and a true minus sign."""
    return NONE if value is None else f"{value:.{digits}f}".replace("-", MINUS)


def signed(value: float, digits: int = 1) -> str:
    """Write a difference with its sign."""
    return f"{value:+.{digits}f}".replace("-", MINUS)


def size(count: int) -> str:
    """Write bytes in the unit that fits: B, kB, MB, GB (powers of 1000)."""
    value = float(count)
    for unit in ("B", "kB", "MB"):
        if value < 999.5:
            return f"{value:.0f} {unit}" if unit == "B" or value >= 100 else f"{value:.3g} {unit}"
        value /= 1000.0
    return f"{value:.3g} GB"


def milliseconds(value: float | None) -> str:
    """Write milliseconds with three digits."""
    return NONE if value is None else f"{value:.3g} ms" if value < 999.5 else f"{value / 1000:.3g} s"


def plain(value: Any) -> str:
    """Write any value of the plan in a form for people."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.4g}".replace("-", MINUS)
    if isinstance(value, dict):
        return ", ".join(f"{str(key).replace('_', ' ')} {plain(each)}" for key, each in value.items())
    if isinstance(value, list | tuple):
        return " × ".join(plain(each) for each in value) if len(value) <= 3 else ", ".join(map(plain, value))
    return NONE if value is None else str(value)


def view_dependence(metrics: MetricsModel) -> int:
    """Return the bytes of all view dependence of the asset; 0 = it has none."""
    return metrics.bytes.get("residuals", 0)


def cards(metrics: MetricsModel) -> list[Card]:
    """Return the headline figures."""
    mean, ulr, diffuse, mesh = metrics.mean, *(metrics.baselines[name] for name in ("ulr", "diffuse", "mesh"))
    found = [
        Card(
            "Held-out photos",
            f"{number(mean.psnr, 1)} dB",
            f"PSNR · SSIM {number(mean.ssim, 3)} · FLIP {number(mean.flip, 3)}",
        )
    ]
    gap = _difference(mean.psnr, ulr.psnr)
    if gap is not None:
        tone = "good" if gap >= -0.5 else "fair" if gap >= -1.5 else "poor"
        found.append(Card("Against the lumigraph", f"{signed(gap)} dB", "blending the four best photos anew", tone))
    share = metrics.bytes["asset"] / max(metrics.bytes["photos"], 1)
    note = f"of the photos' {size(metrics.bytes['photos'])}"
    found.append(
        Card("Asset", size(metrics.bytes["asset"]), f"{100 * share:.0f} % {note}", "good" if share < 1 else "poor")
    )
    faster = _ratio(mesh.ms_per_frame, diffuse.ms_per_frame)
    if faster is not None:
        note = f"{faster:.2g} times Embree's speed without residuals"
        found.append(
            Card(
                "Frame",
                milliseconds(mean.ms_per_frame),
                note,
                "good" if faster >= 1 else "fair" if faster >= 0.5 else "poor",
            )
        )
    return found


def verdict(metrics: MetricsModel) -> list[str]:
    """Return what was found, in sentences."""
    return [
        sentence for sentence in (_error(metrics), _highlights(metrics), _weight(metrics), _speed(metrics)) if sentence
    ]


def _error(metrics: MetricsModel) -> str:
    mean, ulr, diffuse = metrics.mean, metrics.baselines["ulr"], metrics.baselines["diffuse"]
    parts = [f"In {len(metrics.views)} held-out views the asset reaches {number(mean.psnr, 2)} dB PSNR"]
    gap = _difference(mean.psnr, ulr.psnr)
    if gap is not None:
        relation = f"{abs(gap):.2f} dB {'more than' if gap >= 0 else 'less than'}"
        parts.append(f"{relation} blending the four best photos anew at every pixel ({number(ulr.psnr, 2)} dB)")
    gain = _difference(mean.psnr, diffuse.psnr)
    if gain is not None and view_dependence(metrics):
        parts.append(f"{abs(gain):.2f} dB {'more' if gain >= 0 else 'less'} than its diffuse colours alone")
    covered = "" if mean.coverage is None else f" It covers {100 * mean.coverage:.2f} % of the mask."
    return f"{parts[0]}{': ' if parts[1:] else ''}{', and '.join(parts[1:])}.{covered}"


def _highlights(metrics: MetricsModel) -> str:
    if not view_dependence(metrics):
        return "The plan found no view dependence worth its bytes: the asset holds no residuals."
    mean, diffuse, ulr = metrics.mean, metrics.baselines["diffuse"], metrics.baselines["ulr"]
    gain = _difference(mean.psnr_highlight, diffuse.psnr_highlight)
    if gain is None:
        return "No pixel of the held-out photos is far from the diffuse colours."
    share = sum(view.highlight_pixels for view in metrics.views) / max(
        sum(view.mask_pixels for view in metrics.views), 1
    )
    rest = _difference(mean.psnr_rest, diffuse.psnr_rest)
    return (
        f"Where highlights are ({100 * share:.0f} % of the pixels) residuals change the error by {signed(gain)} dB "
        f"({number(diffuse.psnr_highlight, 1)} to {number(mean.psnr_highlight, 1)} dB; lumigraph "
        f"{number(ulr.psnr_highlight, 1)} dB)" + ("" if rest is None else f", elsewhere by {signed(rest)} dB") + "."
    )


def _weight(metrics: MetricsModel) -> str:
    asset, photos = metrics.bytes["asset"], metrics.bytes["photos"]
    share = asset / max(photos, 1)
    relation = f"{100 * share:.0f} % of" if share < 1 else f"{share:.2g} times"
    parts = f"{size(metrics.bytes.get('layers', 0))} layers, {size(view_dependence(metrics))} residuals"
    return f"It weighs {size(asset)} ({parts}), {relation} the photos it was made from ({size(photos)})."


def _speed(metrics: MetricsModel) -> str:
    mean, diffuse, mesh = metrics.mean, metrics.baselines["diffuse"], metrics.baselines["mesh"]
    faster, slower = _ratio(mesh.ms_per_frame, diffuse.ms_per_frame), _ratio(mean.ms_per_frame, mesh.ms_per_frame)
    if faster is None or slower is None:
        return ""
    frame = f"{metrics.protocol.timing_width} × {metrics.protocol.timing_height}"
    return (
        f"A frame of {frame} takes {milliseconds(mean.ms_per_frame)} with residuals and "
        f"{milliseconds(diffuse.ms_per_frame)} without; casting the mesh by Embree takes "
        f"{milliseconds(mesh.ms_per_frame)}: without residuals the asset runs at {faster:.2f} times Embree's speed, "
        f"with them a frame takes {slower:.2f} times as long as Embree's."
    )


def surface_words(surface: Mapping[str, Any]) -> str:
    """Say how well the photos see the surface, from the audit's figures."""
    if not {"unseen", "fewer_than_3", "median_photos"} <= surface.keys():
        return plain(dict(surface))
    return (
        f"{100 * surface['unseen']:.1f} % of the surface is seen by no photo, "
        f"{100 * surface['fewer_than_3']:.1f} % by fewer than three; at the median point "
        f"{plain(surface['median_photos'])} photos see it."
    )


def _difference(one: float | None, other: float | None) -> float | None:
    return None if one is None or other is None else one - other


def _ratio(one: float | None, other: float | None) -> float | None:
    return None if one is None or not other else one / other


def score_cells(scores: Scores) -> list[str]:
    """Return the cells of a row of the table of scores."""
    return [
        number(scores.psnr, 2),
        number(scores.ssim, 4),
        number(scores.flip, 4),
        number(scores.psnr_highlight, 2),
        number(scores.psnr_rest, 2),
        NONE if scores.coverage is None else f"{100 * scores.coverage:.2f} %",
        NONE if scores.depth_rmse is None else f"{scores.depth_rmse:.2g}",
        NONE if scores.ms_per_frame is None else f"{scores.ms_per_frame:.4g}",
        NONE if scores.mpix_per_s is None else f"{scores.mpix_per_s:.3g}",
    ]
