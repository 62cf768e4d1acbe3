"""The main figures of a run as a small table."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rich.console import Console
from rich.table import Table

_COLUMNS = {
    "psnr": ("PSNR dB", "{:.2f}"),
    "ssim": ("SSIM", "{:.4f}"),
    "flip": ("FLIP", "{:.4f}"),
    "depth_rmse": ("depth RMSE", "{:.2e}"),
    "coverage": ("coverage", "{:.2%}"),
    "ms_per_frame": ("ms per frame", "{:.1f}"),
}


def score_table(metrics: Mapping[str, Any]) -> Table:
    """Return the mean scores of the renderers and baselines in the content of ``metrics.json``."""
    table = Table(title=f"mean over {len(metrics['views'])} held-out views", title_justify="left")
    table.add_column("rendered by")
    for heading, _ in _COLUMNS.values():
        table.add_column(heading, justify="right")
    for name, scores in metrics["renderers"].items():
        table.add_row(name, *_cells(scores))
    table.add_section()
    for name, scores in metrics["baselines"].items():
        table.add_row(f"{name} (baseline)", *_cells(scores))
    return table


def _cells(scores: Mapping[str, Any]) -> list[str]:
    return [_cell(scores.get(key), form) for key, (_, form) in _COLUMNS.items()]


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
