"""Time of a frame against the number of trees, at one size of pictures."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ibrpipe.bench.forest.results import ForestRow

_OURS, _WALL, _PEER = "#0b6e8f", "#7fb3c4", "#70767c"
_MARKS = {"far": "o", "middle": "s", "near": "D"}


def write_growth_plot(rows: Sequence[ForestRow], file: Path) -> None:
    """Draw milliseconds against trees, both logarithmic: ours, CPU and wall, and the peer's at equal error.

    Parameters
    ----------
    rows : sequence of ForestRow
        Views with fewer than two forests are left out.
    file : Path
        PNG, SVG or PDF; its folder is made.
    """
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.4, 4.8), layout="constrained")
    axes = figure.add_subplot()
    for view in dict.fromkeys(row.view for row in rows):
        shown = sorted((row for row in rows if row.view == view), key=lambda row: row.trees)
        if len(shown) < 2:
            continue
        mark = _MARKS.get(view, "o")
        trees = [row.trees for row in shown]
        axes.plot(trees, [row.ours_ms for row in shown], f"{mark}-", color=_OURS, label=f"{view}, CPU time")
        axes.plot(trees, [row.ours_wall_ms for row in shown], f"{mark}:", color=_WALL, label=f"{view}, wall time")
        equal = [(row.trees, row.equal_ms) for row in shown if row.equal_ms is not None]
        if equal:
            axes.plot(*zip(*equal), f"{mark}--", color=_PEER, label=f"{view}, Embree at this error")
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel("trees (29,872 triangles each)")
    axes.set_ylabel("ms a frame (wall, or CPU time over threads)")
    axes.grid(True, which="major", color="#e4e4df")
    if axes.lines:
        figure.legend(loc="outside lower center", ncols=2, frameon=False, fontsize=9)
    file.parent.mkdir(parents=True, exist_ok=True)
    with rc_context({"svg.fonttype": "none", "svg.hashsalt": "ibrpipe"}):
        figure.savefig(file, dpi=110)
