"""PSNR against time for every value that was tried: a panel for each of what was varied."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ibrpipe.bench.forest.results import TradeoffRow

_COLORS = {"far": "#0b6e8f", "middle": "#b8541c", "near": "#2f7d3b"}
_TITLES = {
    "pixel_error": "pixel_error: widest texel, pixels",
    "directions": "directions",
    "slab_texels": "slab_texels: thickness of slabs",
}


def write_tradeoff_plot(rows: Sequence[TradeoffRow], file: Path) -> None:
    """Draw PSNR against milliseconds of CPU time, with the values at the points; its folder is made."""
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12.0, 4.4), layout="constrained")
    panels = figure.subplots(1, len(_TITLES), sharey=True)
    for axes, (varied, title) in zip(panels, _TITLES.items()):
        for view in dict.fromkeys(row.view for row in rows):
            shown = sorted((r for r in rows if (r.varied, r.view) == (varied, view)), key=lambda row: row.value)
            color = _COLORS.get(view, "#70767c")
            axes.plot([r.ours_ms for r in shown], [r.ours_psnr for r in shown], "o-", color=color, label=view)
            for row in shown:
                place = (row.ours_ms, row.ours_psnr)
                axes.annotate(f"{row.value:g}", place, xytext=(3, 4), textcoords="offset points", fontsize=8)
        axes.set_title(title, fontsize=10, loc="left")
        axes.set_xscale("log")
        axes.set_xlabel("ms a frame (CPU time over threads)")
        axes.grid(True, which="major", color="#e4e4df")
    panels[0].set_ylabel("PSNR, dB")
    panels[0].legend(frameon=False, fontsize=9)
    file.parent.mkdir(parents=True, exist_ok=True)
    with rc_context({"svg.fonttype": "none", "svg.hashsalt": "ibrpipe"}):
        figure.savefig(file, dpi=110)
