"""The main figures of a run as a small table."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.table import Table

if TYPE_CHECKING:  # the command line starts without pydantic's models
    from ibrpipe.evaluation.metrics import MetricsModel, Scores

_MASK = {"psnr": ("PSNR dB", "{:.2f}"), "ssim": ("SSIM", "{:.4f}"), "flip": ("FLIP", "{:.4f}")}
_COVERED = {f"{name}_covered": column for name, column in _MASK.items()}
_REST = {
    "coverage": ("coverage", "{:.2%}"),
    "depth_rmse": ("depth RMSE", "{:.2e}"),
    "ms_per_frame": ("ms per frame", "{:.1f}"),
}
Columns = Mapping[str, tuple[str, str]]


def score_table(metrics: MetricsModel) -> Table:
    """Return the mean scores of the renderers and baselines, the headline first."""
    whole = {"psnr": ("whole picture dB", "{:.2f}")}
    covered = {"psnr_covered": ("covered by all dB", "{:.2f}")}
    columns = {**_COVERED, **_REST, **whole} if metrics.headline == "covered" else {**_MASK, **_REST, **covered}
    fit = None if metrics.views else metrics.training
    title = f"mean over {len(metrics.views)} held-out views"
    if fit is not None:
        title = f"no photo is held out: fit to {len(fit.views)} of the photos themselves"
    table = Table(title=title, title_justify="left")
    table.add_column("rendered by")
    for heading, _ in columns.values():
        table.add_column(heading, justify="right")
    known = fit or metrics
    for name, scores in known.renderers.items():
        table.add_row(name, *_cells(columns, scores))
    table.add_section()
    for name, scores in known.baselines.items():
        table.add_row(f"{name} (baseline)", *_cells(columns, scores))
    return table


def _cells(columns: Columns, scores: Scores) -> list[str]:
    return [_cell(getattr(scores, key), form) for key, (_, form) in columns.items()]


def _cell(value: float | None, form: str) -> str:
    return "-" if value is None else form.format(value)


def facts_table(title: str, facts: Mapping[str, Any]) -> Table:
    """Return a table of names and values without lines."""
    table = Table(title=title, title_justify="left", show_header=False, box=None, pad_edge=False)
    table.add_column(style="bold")
    table.add_column(overflow="fold")
    for name, value in facts.items():
        table.add_row(name, str(value))
    return table


def print_table(*tables: Table) -> None:
    """Print tables on stdout, as wide as they need where it is no terminal."""
    console = Console(highlight=False)
    if not console.is_terminal:
        console = Console(highlight=False, width=160)
    for table in tables:
        console.print(table, markup=False)
