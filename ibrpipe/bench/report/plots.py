"""Plots of the speed-error page, as SVG text: Pareto plots and curves of growth."""

from __future__ import annotations

import io
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

from ibrpipe.bench.rate_error.results import RateCurve
from ibrpipe.bench.sizes.results import Table2Row
from ibrpipe.bench.speed_error.results import ContenderFacts, Growth, Score, SpeedErrorModel

INK, MUTED, GRID = "#1d2329", "#5d6770", "#e4e4df"
#: colour of each renderer, in the order of the registry; peers are grey
COLORS = ("#0b6e8f", "#b8541c", "#2f7d3b", "#7a4aa0", "#a3812a", "#c2387a")
PEER = "#70767c"
MARKERS = "osD^vPX<>ph*"
#: least error that a logarithmic axis shows
FLOOR = 1e-7


def styles(contenders: Sequence[ContenderFacts]) -> dict[str, tuple[str, str]]:
    """Return colour (one for each renderer) and marker (one for each of its settings) of every contender."""
    renderers = [name for name in dict.fromkeys(c.renderer for c in contenders) if name != "peer"]
    found, count = {}, dict.fromkeys((*renderers, "peer"), 0)
    for each in contenders:
        color = PEER if each.renderer == "peer" else COLORS[renderers.index(each.renderer) % len(COLORS)]
        found[each.label] = (color, MARKERS[count[each.renderer] % len(MARKERS)])
        count[each.renderer] += 1
    return found


def pareto_plot(model: SpeedErrorModel, work: str, views: Sequence[str], colour: bool) -> str:
    """Draw milliseconds against error, a panel for each view; who is on the front is joined by a line.

    `colour`: error of colour against the time of colour and depth; else error of depth against the time of depth.
    """
    rows = -(-len(views) // 2)
    figure, panels, legend = _figure(rows, 2, 3.1 if rows > 1 else 4.7)  # the legend needs its height
    marks, shown = styles(model.contenders), set()
    for view, axes in zip(views, panels):
        points = _points([s for s in model.scores if s.work == work and s.view == view], colour)
        shown |= set(points)
        for label, (x, y) in points.items():
            color, marker = marks[label]
            axes.plot(
                [x], [y], marker, color=color, markersize=8, markeredgecolor="white", markeredgewidth=0.7, zorder=3
            )
        front = _front(list(points.values()))
        axes.plot([x for x, _ in front], [y for _, y in front], "-", color="#b9c0c6", linewidth=1.4, zorder=1)
        axes.set_title(view, fontsize=11, color=INK, loc="left")
        axes.set_xscale("log")
        axes.set_yscale("log")
        if not colour:
            axes.set_ylim(FLOOR / 2, 2)
        _dress(axes)
        if colour:
            axes.margins(y=0.12)
            _plain_ticks(axes.yaxis, *axes.get_ylim())
    for axes in panels[len(views) :]:
        axes.set_visible(False)
    error = "RMS error of colour, 8-bit sRGB codes" if colour else "mean error, texels (1 = wrong)"
    figure.supxlabel(f"milliseconds a frame of {model.width} × {model.height}", fontsize=10, color=MUTED, x=0.42)
    figure.supylabel(error, fontsize=10, color=MUTED, x=0.005)
    _legend(legend, marks, [c.label for c in model.contenders if c.label in shown])
    return _svg(figure)


def growth_plot(model: SpeedErrorModel, series: Sequence[str]) -> str:
    """Draw time against size for one or two series, a panel each; slopes stand in the table below."""
    figure, panels, legend = _figure(1, max(2, len(series)), 3.6)
    marks, shown = styles(model.contenders), []
    main = {each.label for each in model.contenders if each.main}
    for name, axes in zip(series, panels):
        mine = [c for c in model.growth if c.series == name and c.contender in main and len(c.sizes) > 1]
        for curve in mine:
            color, marker = marks[curve.contender]
            _curve(axes, list(zip(curve.sizes, curve.milliseconds)), color, marker)
            shown.append(curve.contender)
        _squared(axes, mine)
        axes.set_title(name, fontsize=11, color=INK, loc="left")
        _log_sizes(axes)
        _dress(axes)
    for axes in panels[len(series) :]:
        axes.set_visible(False)
    figure.supxlabel("n: texels along a side", fontsize=10, color=MUTED, x=0.42)
    figure.supylabel("milliseconds, fastest frame", fontsize=10, color=MUTED, x=0.005)
    _legend(legend, marks, list(dict.fromkeys(shown)))
    return _svg(figure)


def table2_plot(rows: Sequence[Table2Row]) -> str:
    """Draw milliseconds against size, a panel for each model: its searches, and the paper's own times in grey."""
    models = list(dict.fromkeys(row.model for row in rows))
    figure, panels, legend = _figure(1, max(2, len(models)), 3.4)
    searches = list(dict.fromkeys(row.search for row in rows))
    marks = {search: (COLORS[n % len(COLORS)], MARKERS[n]) for n, search in enumerate(searches)}
    marks["paper"] = (PEER, "P")
    for model, axes in zip(models, panels):
        mine = [row for row in rows if row.model == model]
        for search in searches:
            points = [(row.size, row.milliseconds) for row in mine if row.search == search]
            _curve(axes, points, *marks[search])
        _curve(axes, sorted({(row.size, row.paper) for row in mine if row.paper}), *marks["paper"])
        _slope_two(axes, [row.size for row in mine], min(row.milliseconds for row in mine if row.size == mine[-1].size))
        axes.set_title(f"{model}, {mine[0].maps} maps", fontsize=11, color=INK, loc="left")
        _log_sizes(axes)
        _dress(axes)
    for axes in panels[len(models) :]:
        axes.set_visible(False)
    figure.supxlabel("n: texels and pixels along a side", fontsize=10, color=MUTED, x=0.42)
    figure.supylabel("milliseconds, median", fontsize=10, color=MUTED, x=0.005)
    _legend(legend, marks, [*searches, "paper"])
    return _svg(figure)


def region_plot(curves: Sequence[Growth]) -> str:
    """Draw the curves of one contender: time against size for every region of the epipole, and their slopes."""
    figure, panels, legend = _figure(1, 2, 3.6)
    marks = {}
    for n, curve in enumerate(curves):
        label = curve.series.removeprefix("epipole ")
        marks[label] = (COLORS[n % len(COLORS)], MARKERS[n % len(MARKERS)])
        _curve(panels[0], list(zip(curve.sizes, curve.milliseconds)), *marks[label])
        color, marker = marks[label]
        steps = [f"{a} to {b}" for a, b in pairwise(curve.sizes)]
        panels[1].plot(steps, curve.doublings, marker + "-", color=color, markersize=6, linewidth=1.2)
    _squared(panels[0], curves)
    panels[1].axhline(4.0, linestyle=":", color=MUTED, linewidth=1.2)
    panels[1].set_ylim(bottom=0)
    for axes, title in zip(panels, (f"{curves[0].contender}: milliseconds", "factor at each doubling (dotted: n²)")):
        axes.set_title(title, fontsize=11, color=INK, loc="left")
    _log_sizes(panels[0])
    for axes in panels:
        _dress(axes)
    figure.supxlabel("n: texels and pixels along a side", fontsize=10, color=MUTED, x=0.42)
    _legend(legend, marks, list(marks))
    return _svg(figure)


#: series of the rate-error page: colour, marker, whether its points are joined
RATE_MARKS = {
    "whole": (COLORS[0], "o"),
    "diffuse": (COLORS[2], "s"),
    "paper": (COLORS[1], "D"),
    "raw": (COLORS[3], "P"),
    "lumigraph": (PEER, "X"),
}


def rate_plot(curve: RateCurve) -> str:
    """Draw PSNR and FLIP against the asset's share of the photos' bytes, a line for each series."""
    figure, panels, legend = _figure(1, 2, 4.0)
    for axes, name in zip(panels, ("psnr", "flip")):
        for series, (color, marker) in RATE_MARKS.items():
            mine = [(100 * point.share, getattr(point, name)) for point in curve.points if point.series == series]
            mine = [(x, y) for x, y in mine if y is not None]
            line = "-" if series in ("whole", "diffuse") else ""
            axes.plot(*zip(*sorted(mine)), marker + line, color=color, markersize=6, linewidth=1.2) if mine else None
        axes.set_title(
            {"psnr": "PSNR, dB", "flip": "FLIP (0 = no difference)"}[name], fontsize=11, color=INK, loc="left"
        )
        axes.set_xscale("log")
        _dress(axes)
    figure.supxlabel("bytes, percent of the photos'", fontsize=10, color=MUTED, x=0.42)
    _legend(legend, RATE_MARKS, [name for name in RATE_MARKS if any(p.series == name for p in curve.points)])
    return _svg(figure)


def _curve(axes: Any, points: Sequence[tuple[float, float]], color: str, marker: str) -> None:
    axes.plot([x for x, _ in points], [y for _, y in points], marker + "-", color=color, markersize=6, linewidth=1.5,
              markeredgecolor="white", markeredgewidth=0.6)  # fmt: skip


def _slope_two(axes: Any, sizes: Sequence[int], least: float) -> None:
    sizes = sorted(set(sizes))
    drawn = [y for line in axes.lines for y in line.get_ydata()]
    axes.plot(sizes, [0.6 * least * (n / sizes[-1]) ** 2 for n in sizes], ":", color=MUTED, linewidth=1.2)
    axes.annotate("n²", (sizes[-1], 0.6 * least), (3, -2), textcoords="offset points", fontsize=9, color=MUTED)
    if drawn:
        axes.set_ylim(0.5 * min(drawn), 1.6 * max(drawn))


def _squared(axes: Any, curves: Sequence[Growth]) -> None:
    """Draw a dotted line of slope 2 below the curves: time that grows with the number of texels."""
    sizes = sorted({n for curve in curves for n in curve.sizes})
    if len(sizes) > 1:
        _slope_two(axes, sizes, min(time for curve in curves for time in curve.milliseconds[-1:]))


def _log_sizes(axes: Any) -> None:
    from matplotlib.ticker import NullLocator

    axes.set_xscale("log", base=2)
    axes.set_yscale("log")
    axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
    axes.xaxis.set_minor_locator(NullLocator())
    _plain_ticks(axes.yaxis, *axes.get_ylim())


def _points(scores: Sequence[Score], colour: bool) -> dict[str, tuple[float, float]]:
    """Return milliseconds and error of everyone who has both; peers without a colour of their own keep out."""
    found = {}
    for score in scores:
        timing = score.both if colour else score.depth or score.both
        error = score.codes if colour else max(score.clipped, FLOOR)
        if timing is not None and error is not None and not (colour and score.contender == "Embree"):
            found[score.contender] = (timing.milliseconds, error)
    return found


def _front(points: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return the points that nobody beats in both, from fast to slow; an error a hundredth less is no less."""
    front: list[tuple[float, float]] = []
    for x, y in sorted(points):
        if not front or y < 0.99 * front[-1][1]:
            front.append((x, y))
    return front


def _figure(rows: int, columns: int, height: float) -> tuple[Any, list[Any], Any]:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12.6, height * rows + 0.5), dpi=72)
    grid = figure.add_gridspec(
        rows, columns + 1, width_ratios=[1] * columns + [0.42], left=0.062, right=0.995, wspace=0.2,
        top=1 - 0.3 / (height * rows), bottom=0.62 / (height * rows), hspace=0.34,
    )  # fmt: skip
    panels = [figure.add_subplot(grid[row, column]) for row in range(rows) for column in range(columns)]
    legend = figure.add_subplot(grid[:, columns])
    legend.axis("off")
    return figure, panels, legend


def _legend(axes: Any, marks: dict[str, tuple[str, str]], labels: Sequence[str]) -> None:
    from matplotlib.lines import Line2D

    handles = [
        Line2D([], [], marker=marks[name][1], color=marks[name][0], linestyle="", markersize=8, label=name)
        for name in labels
    ]
    axes.legend(handles=handles, loc="upper left", frameon=False, fontsize=10, labelcolor=INK, borderaxespad=0)


def _dress(axes: Any) -> None:
    axes.grid(True, color=GRID, linewidth=0.8)
    axes.set_axisbelow(True)
    axes.tick_params(colors=MUTED, length=0, which="both", labelsize=9)
    axes.margins(x=0.12)
    if axes.get_xscale() == "log" and axes.xaxis.get_transform().base == 10:
        _plain_ticks(axes.xaxis, *axes.get_xlim())
    for side in ("top", "right", "left"):
        axes.spines[side].set_visible(False)
    axes.spines["bottom"].set_color("#c9cbc7")


def _plain_ticks(axis: Any, low: float, high: float) -> None:
    """Write 0.1, 1, 2, 5, 10 rather than powers of ten."""
    from matplotlib.ticker import FixedLocator, NullLocator

    steps = (1, 2, 5) if high / low < 200 else (1,)
    values = [step * 10.0**power for power in range(-4, 6) for step in steps]
    axis.set_major_locator(FixedLocator([value for value in values if low <= value <= high]))
    axis.set_minor_locator(NullLocator())
    axis.set_major_formatter(lambda value, _: f"{value:g}")


def _svg(figure: Any) -> str:
    from matplotlib import rc_context
    from matplotlib.backends.backend_svg import FigureCanvasSVG

    target = io.StringIO()
    with rc_context({"svg.fonttype": "none", "svg.hashsalt": "ibrpipe", "font.family": "sans-serif"}):
        no_metadata = dict.fromkeys(("Creator", "Date", "Format", "Type"))
        FigureCanvasSVG(figure).print_svg(target, metadata=no_metadata)
    text = target.getvalue()
    return text[text.index("<svg") :]
