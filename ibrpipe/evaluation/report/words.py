"""The verdict in words, and how figures are written."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ibrpipe.evaluation.headline import headline, judged, second
from ibrpipe.evaluation.metrics import MetricsModel, Scores
from ibrpipe.io.documents.audit import AuditedSurface

NONE = "–"
MINUS = "−"
#: share of the pictures that a method may cover less than another and still be called as good
LESS_COVERED = 0.02


@dataclass(frozen=True)
class Card:
    """One headline figure; `tone` is "good", "fair", "poor" or "plain"."""

    label: str
    value: str
    note: str
    tone: str = "plain"


def number(value: float | None, digits: int) -> str:
    """Write a figure with a fixed number of decimals and a true minus sign; what rounds to zero has no sign."""
    return NONE if value is None else f"{_unsigned_zero(value, digits):.{digits}f}".replace("-", MINUS)


def signed(value: float, digits: int = 1) -> str:
    """Write a difference with its sign; one that rounds to zero has none."""
    rounded = _unsigned_zero(value, digits)
    return f"{rounded:+.{digits}f}".replace("-", MINUS) if rounded else f"{0:.{digits}f}"


def _unsigned_zero(value: float, digits: int) -> float:
    return round(value, digits) or 0.0


def percent(share: float | None) -> str:
    """Write a share in percent, exact enough to tell almost all from all."""
    if share is None:
        return NONE
    return f"{100 * share:.2f} %" if share > 0.99 else f"{100 * share:.0f} %"


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
    mesh = metrics.baselines["mesh"]
    found = [_likeness_card(metrics), *_coverage_card(metrics), *_gap_card(metrics)]
    share = metrics.bytes["asset"] / max(metrics.bytes["photos"], 1)
    note = f"of the photos' {size(metrics.bytes['photos'])}"
    found.append(
        Card("Asset", size(metrics.bytes["asset"]), f"{100 * share:.0f} % {note}", "good" if share < 1 else "poor")
    )
    faster = _ratio(mesh.ms_per_frame, metrics.mean.ms_per_frame)
    if faster is not None:
        note = f"{faster:.2g} times the speed of Embree's cast of the mesh"
        found.append(
            Card(
                "Frame",
                milliseconds(metrics.mean.ms_per_frame),
                note,
                "good" if faster >= 1 else "fair" if faster >= 0.5 else "poor",
            )
        )
    return found


def _likeness_card(metrics: MetricsModel) -> Card:
    known = judged(metrics)
    first = known.renderers[metrics.renderer]
    mean = headline(metrics, first)
    note = f"PSNR · SSIM {number(mean.ssim, 3)} · FLIP {number(mean.flip, 3)}"
    if metrics.headline == "covered":
        note += f" · over the {percent(known.covered_share)} of the pictures that all methods cover"
    elif first.coverage is not None:
        note += f" · coverage {percent(first.coverage)}"
    label = "Held-out photos" if known.new else "Its own photos (new views: not measured)"
    return Card(label, f"{number(mean.psnr, 1)} dB", note)


def _coverage_card(metrics: MetricsModel) -> list[Card]:
    """Return what is covered, and the figure over the whole, where the headline leaves the rest out."""
    first = judged(metrics).renderers[metrics.renderer]
    if metrics.headline != "covered" or first.coverage is None:
        return []
    whole = f"of the pictures · {number(second(metrics, first).psnr, 1)} dB over the whole, where the rest is black"
    return [Card("Coverage", percent(first.coverage), whole)]


def _gap_card(metrics: MetricsModel) -> list[Card]:
    """Return the difference from the lumigraph; who covers less than it is not praised."""
    own, ulr = metrics.mean, metrics.baselines["ulr"]
    gap = _difference(headline(metrics, own).psnr, headline(metrics, ulr).psnr)
    if gap is None:
        return []
    less = _difference(ulr.coverage, own.coverage) or 0.0
    note = "blending the four best photos anew"
    if less > LESS_COVERED:
        note += f", which covers {percent(less)} more"
    tone = "poor" if gap < -1.5 else "fair" if round(gap, 1) < 0 or less > LESS_COVERED else "good"
    return [Card("Against the lumigraph", f"{signed(gap)} dB", note, tone)]


def verdict(metrics: MetricsModel) -> list[str]:
    """Return what was found, in sentences."""
    found = (_error(metrics), *metrics.not_measured, _highlights(metrics), _weight(metrics), _speed(metrics))
    return [sentence for sentence in found if sentence]


def summary_lines(metrics: MetricsModel) -> list[str]:
    """Return what the terminal shows of the verdict."""
    return [_error(metrics), *metrics.not_measured]


def _error(metrics: MetricsModel) -> str:
    known = judged(metrics)
    own, ulr, diffuse = known.renderers[metrics.renderer], known.baselines.get("ulr"), known.baselines["diffuse"]
    mean = headline(metrics, own)
    where = f"In {len(known.views)} held-out views" if known.new else f"On {len(known.views)} of its own photos"
    inside = ""
    if metrics.headline == "covered":
        inside = f" inside what all methods cover ({percent(known.covered_share)} of the pictures)"
    parts = [f"{where} the asset reaches {number(mean.psnr, 2)} dB PSNR{inside}"]
    gap = None if ulr is None else _difference(mean.psnr, headline(metrics, ulr).psnr)
    if gap is not None and ulr is not None:
        than = f"blending the four best photos anew at every pixel ({number(headline(metrics, ulr).psnr, 2)} dB)"
        parts.append(f"{_relation(gap)} {than}")
    gain = _difference(mean.psnr, headline(metrics, diffuse).psnr)
    if gain is not None and view_dependence(metrics):
        parts.append(f"{_relation(gain)} its diffuse colours alone")
    return f"{parts[0]}{': ' if parts[1:] else ''}{', and '.join(parts[1:])}.{_covered(metrics, own, ulr)}"


def _relation(difference: float) -> str:
    return f"{abs(difference):.2f} dB {'more' if difference >= 0 else 'less'} than"


def _covered(metrics: MetricsModel, own: Scores, ulr: Scores | None) -> str:
    """Say how much is covered, and what the figure over the other pixels is."""
    if own.coverage is None:
        return ""
    other = second(metrics, own).psnr
    if metrics.headline == "covered":
        known = None if ulr is None else second(metrics, ulr).psnr
        beside = "" if known is None else f" (lumigraph {number(known, 2)} dB)"
        whole = f"over the whole, where the rest is black, it reaches {number(other, 2)} dB{beside}"
        return f" It covers {percent(own.coverage)} of the pictures; {whole}."
    inside = "" if other is None else f"; inside what all methods cover it reaches {number(other, 2)} dB"
    return f" It covers {100 * own.coverage:.2f} % of the mask{inside}."


def _highlights(metrics: MetricsModel) -> str:
    if not view_dependence(metrics):
        return "The plan found no view dependence worth its bytes: the asset holds no residuals."
    known = judged(metrics)
    mean, diffuse, ulr = known.renderers[metrics.renderer], known.baselines["diffuse"], known.baselines.get("ulr")
    gain = _difference(mean.psnr_highlight, diffuse.psnr_highlight)
    if gain is None:
        return "No covered pixel of the photos is far from the diffuse colours."
    rest = _difference(mean.psnr_rest, diffuse.psnr_rest)
    lit = None if ulr is None else ulr.psnr_highlight
    beside = "" if lit is None else f"; lumigraph {number(lit, 1)} dB"
    return (
        f"Where highlights are ({100 * known.highlight_share:.0f} % of the covered pixels) residuals change the error "
        f"by {signed(gain)} dB ({number(diffuse.psnr_highlight, 1)} to {number(mean.psnr_highlight, 1)} dB{beside})"
        + ("" if rest is None else f", elsewhere by {signed(rest)} dB")
        + "."
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
    if not view_dependence(metrics):
        return (
            f"A frame of {frame} takes {milliseconds(mean.ms_per_frame)}; casting the mesh by Embree takes "
            f"{milliseconds(mesh.ms_per_frame)}: a frame takes {slower:.2f} times as long."
        )
    return (
        f"A frame of {frame} takes {milliseconds(mean.ms_per_frame)} with residuals and "
        f"{milliseconds(diffuse.ms_per_frame)} without; casting the mesh by Embree takes "
        f"{milliseconds(mesh.ms_per_frame)}: without residuals the asset runs at {faster:.2f} times Embree's speed, "
        f"with them a frame takes {slower:.2f} times as long as Embree's."
    )


def surface_words(surface: AuditedSurface) -> str:
    """Say how well the photos see the surface, from the audit's figures."""
    return (
        f"{100 * surface.unseen:.1f} % of the surface is seen by no photo, {100 * surface.fewer_than_3:.1f} % by fewer "
        f"than three; at the median point {surface.median_photos} photos see it."
    )


def _difference(one: float | None, other: float | None) -> float | None:
    return None if one is None or other is None else one - other


def _ratio(one: float | None, other: float | None) -> float | None:
    return None if one is None or not other else one / other


def likeness(metrics: MetricsModel, scores: Scores) -> str:
    """Return the headline's figures of one picture, with its coverage."""
    mean = headline(metrics, scores)
    figures = f"{number(mean.psnr, 2)} dB · SSIM {number(mean.ssim, 3)} · FLIP {number(mean.flip, 3)}"
    return f"{figures} · coverage {percent(scores.coverage)}"


def score_cells(metrics: MetricsModel, scores: Scores, depth: bool = True) -> list[str]:
    """Return the cells of a row of the table of scores, the headline's figures first; `depth` with those of depth."""
    first, other = headline(metrics, scores), second(metrics, scores)
    return [
        *(number(first.psnr, 2), number(first.ssim, 4), number(first.flip, 4)),
        NONE if scores.coverage is None else f"{100 * scores.coverage:.2f} %",
        *(number(other.psnr, 2), number(other.ssim, 4), number(other.flip, 4)),
        number(scores.psnr_highlight, 2),
        number(scores.psnr_rest, 2),
        *([NONE if scores.depth_rmse is None else f"{scores.depth_rmse:.2g}"] if depth else []),
        NONE if scores.ms_per_frame is None else f"{scores.ms_per_frame:.4g}",
        NONE if scores.mpix_per_s is None else f"{scores.mpix_per_s:.3g}",
    ]
