"""The pages of time against size: table 2 of schaufler1999, and growth by the region of the epipole."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ibrpipe.bench.report.plots import region_plot, styles, table2_plot
from ibrpipe.bench.report.template import fill, picture
from ibrpipe.bench.sizes.growth import ROUNDS
from ibrpipe.bench.sizes.results import GrowthModel, Table2Model, Table2Row
from ibrpipe.bench.sizes.table2 import Table2Run


def write_table2_page(path: Path, run: Table2Run) -> None:
    """Write the page: one file without scripts that loads nothing from anywhere."""
    from markupsafe import Markup

    assert run.model is not None
    images = [
        {"label": f"{model}, {search}", "image": picture(np.rint(255 * pixels).astype(np.uint8), 384)}
        for (model, search), pixels in run.pictures.items()
    ]
    svg = Markup(table2_plot(run.model.rows))
    path.write_text(
        fill("table2.html", model=run.model, tables=tables(run.model), svg=svg, images=images), encoding="utf-8"
    )


def tables(model: Table2Model) -> list[dict[str, Any]]:
    """One row for each model and search, as the paper prints them: times and growth by size."""
    sizes = sorted({row.size for row in model.rows})
    found: dict[tuple[str, str], dict[int, Table2Row]] = {}
    for row in model.rows:
        found.setdefault((row.model, row.search), {})[row.size] = row
    return [
        {"model": name, "search": search, "maps": next(iter(mine.values())).maps, "cells": _cells(mine, sizes)}
        for (name, search), mine in found.items()
    ]


def _cells(mine: dict[int, Table2Row], sizes: Sequence[int]) -> list[Table2Row | None]:
    return [mine.get(size) for size in sizes]


def write_growth_page(path: Path, model: GrowthModel) -> None:
    """Write the page of growth by the region of the epipole."""
    from markupsafe import Markup

    names = [contender.label for contender in model.contenders]
    curves = {name: [curve for curve in model.growth if curve.contender == name] for name in names}
    regions = list(dict.fromkeys(curve.series.removeprefix("epipole ") for curve in model.growth))
    plots = [Markup(region_plot(mine)) for mine in curves.values() if mine]
    colors = {label: color for label, (color, _) in styles(model.contenders).items()}
    page = fill("growth.html", model=model, curves=curves, plots=plots, regions=regions, colors=colors, rounds=ROUNDS)
    path.write_text(page, encoding="utf-8")
