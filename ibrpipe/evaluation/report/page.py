"""Fill the page's template and write it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from importlib import resources
from pathlib import Path
from typing import Any

from ibrpipe.evaluation.headline import headline, judged
from ibrpipe.evaluation.metrics import MetricsModel
from ibrpipe.evaluation.report import words
from ibrpipe.evaluation.report.error_pictures import WORST_CODES, ErrorPictures
from ibrpipe.evaluation.report.pictures import GAIN, UNCOVERED, ViewPictures, heat_colors
from ibrpipe.evaluation.report.plot import speed_error_plot
from ibrpipe.evaluation.report.sources import ReportSources
from ibrpipe.evaluation.report.surface_pictures import PALE, WORST, SurfacePictures, confidence_colors, error_colors
from ibrpipe.evaluation.report.surface_words import surface_sentences
from ibrpipe.evaluation.report.turntable import Turntable, policy
from ibrpipe.types import Array

NAMES = {
    "diffuse": "diffuse only",
    "ulr": "lumigraph of the photos",
    "mesh": "mesh, median colours",
}
PARTS = {
    "layers": "layered depth images",
    "residuals": "residuals",
    "asset_other": "other files of the asset",
    "asset": "asset, all",
    "photos": "training photos",
    "masks": "their masks",
    "mesh": "mesh",
}


def write_report(
    path: Path,
    metrics: MetricsModel,
    pictures: Sequence[ViewPictures],
    sources: ReportSources,
    surfaces: Sequence[SurfacePictures] = (),
    errors: Sequence[ErrorPictures] = (),
    turntable: Turntable | None = None,
) -> None:
    """Write ``report.html``: one file that loads nothing from anywhere; its script enlarges pictures."""
    path.write_text(render_page(metrics, pictures, sources, surfaces, errors, turntable), encoding="utf-8")


def render_page(
    metrics: MetricsModel,
    pictures: Sequence[ViewPictures],
    sources: ReportSources,
    surfaces: Sequence[SurfacePictures] = (),
    errors: Sequence[ErrorPictures] = (),
    turntable: Turntable | None = None,
) -> str:
    """Return the page as HTML text."""
    from jinja2 import Environment, StrictUndefined
    from markupsafe import Markup

    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    environment.filters.update(
        number=words.number,
        size=words.size,
        plain=words.plain,
        surface_words=words.surface_words,
        percent=words.percent,
        likeness=lambda scores: words.likeness(metrics, scores),
    )
    known = judged(metrics)
    depth = any(scores.depth_rmse is not None for scores in known.renderers.values())
    rows = _rows(metrics, depth)
    if not words.view_dependence(metrics):  # the renders are the diffuse colours
        rows = [row for row in rows if row["name"] != "diffuse"]
        pictures = [_without_diffuse(view) for view in pictures]
    script = "\n" + "".join(_resource(name) for name in ("enlarge.js", "turntable.js"))
    template = environment.from_string(_resource("template.html"))
    return template.render(
        metrics=metrics,
        sources=sources,
        pictures=pictures,
        names=NAMES,
        cards=words.cards(metrics),
        verdict=words.verdict(metrics),
        judged=known,
        depth=depth,
        first_psnr=lambda scores: headline(metrics, scores).psnr,
        plot=Markup(speed_error_plot(metrics)) if metrics.views else None,
        rows=rows,
        scored_rows=[row for row in rows if row["scored"]],
        parts=_bars(_parts(metrics)),
        seconds=_bars(metrics.seconds),
        total_seconds=sum(metrics.seconds.values()),
        heat=_gradient(heat_colors()),
        script=Markup(script),
        policy=policy(script, turntable),
        turntable=turntable,
        surfaces=surfaces,
        errors=errors,
        worst_codes=WORST_CODES,
        surface_lines=surface_sentences(
            metrics.geometry, sources.geometry, metrics.geometry_truth, sources.geometry_memory_bytes
        ),
        error_ramp=_gradient(error_colors()),
        confidence_ramp=_gradient(confidence_colors()),
        worst=100 * WORST,
        pale="rgb({}, {}, {})".format(*PALE),
        uncovered="rgb({}, {}, {})".format(*UNCOVERED),
        gain=GAIN,
    )


def _resource(name: str) -> str:
    return resources.files("ibrpipe.evaluation.report").joinpath(name).read_text(encoding="utf-8")


def _without_diffuse(view: ViewPictures) -> ViewPictures:
    return replace(view, columns=tuple(column for column in view.columns if column.name != "diffuse"))


def _parts(metrics: MetricsModel) -> dict[str, int]:
    """Return what takes bytes by its name; view dependence by kind, too, where there are several kinds."""
    kinds = metrics.view_dependence if len(metrics.view_dependence) > 1 else {}
    found: dict[str, int] = {}
    for name, count in metrics.bytes.items():
        if name in PARTS and count:
            found[PARTS[name]] = count
        if name == "residuals":
            found |= {f"of these {kind}": each for kind, each in kinds.items()}
    return found


def _rows(metrics: MetricsModel, depth: bool) -> list[dict[str, Any]]:
    """Return the rows of the table of scores."""
    known = judged(metrics)
    everyone = [("renderer", *item) for item in known.renderers.items()]
    everyone += [("baseline", *item) for item in known.baselines.items()]
    return [
        {
            "kind": kind,
            "name": name,
            "label": NAMES.get(name, name),
            "cells": words.score_cells(metrics, scores, depth),
            "scored": scores.psnr is not None,
        }
        for kind, name, scores in everyone
    ]


def _bars(values: dict[str, Any]) -> list[tuple[str, Any, float]]:
    """Return name, value and length in percent of the longest bar."""
    longest = max(values.values(), default=0) or 1
    return [(name, value, 100.0 * value / longest) for name, value in values.items()]


def _gradient(colors: Array) -> str:
    """Return (256, 3) colours as CSS stops."""
    return ", ".join("#{:02x}{:02x}{:02x}".format(*color) for color in colors[::17])
