"""The plot of speed against error, as SVG text."""

from __future__ import annotations

import io
from typing import Any

from ibrpipe.evaluation.headline import headline
from ibrpipe.evaluation.metrics import MetricsModel
from ibrpipe.evaluation.report.words import milliseconds

INK, MUTED, GRID = "#1d2329", "#6b747d", "#e4e4df"
ASSET, BASELINE = "#0b6e8f", "#a9562b"
#: where a label may stand: offset in points from the mark, and how it is aligned
PLACES = (
    (11, 0, "left"),
    (-11, 0, "right"),
    (0, 24, "center"),
    (0, -24, "center"),
    (11, 24, "left"),
    (11, -24, "left"),
)
_LETTER, _LABEL_HEIGHT = 5.3, 27.0

Box = tuple[float, float, float, float]


def speed_error_plot(metrics: MetricsModel) -> str:
    """Draw milliseconds a frame (logarithmic) against the root mean square error in 8-bit codes; ``<svg ...>``."""
    from matplotlib import rc_context
    from matplotlib.backends.backend_svg import FigureCanvasSVG
    from matplotlib.figure import Figure

    marks = _marks(metrics)
    with rc_context({"svg.fonttype": "none", "svg.hashsalt": "ibrpipe", "font.family": "sans-serif"}):
        figure = Figure(figsize=(8.4, 4.2), dpi=72)
        axes = figure.add_axes((0.08, 0.13, 0.9, 0.83))
        _dress(axes, metrics, marks)
        _draw(axes, marks)
        target = io.StringIO()
        no_metadata = dict.fromkeys(("Creator", "Date", "Format", "Type"))
        FigureCanvasSVG(figure).print_svg(target, metadata=no_metadata)
    text = target.getvalue()
    return text[text.index("<svg") :]


def rms_codes(psnr: float) -> float:
    """Return the root mean square error in 8-bit codes that a PSNR stands for."""
    return 255.0 * float(10.0 ** (-psnr / 20.0))


def _marks(metrics: MetricsModel) -> list[tuple[str, float, float, str, str]]:
    """Return label, milliseconds, error, colour and filling of everyone who has both figures."""
    marks = []
    for color, group in ((ASSET, metrics.renderers), (BASELINE, metrics.baselines)):
        for name, scores in group.items():
            psnr = headline(metrics, scores).psnr
            if psnr is not None and scores.ms_per_frame is not None:
                label = f"{name}\n{milliseconds(scores.ms_per_frame)}, {psnr:.1f} dB"
                filling = "white" if name == "mesh" and group is metrics.baselines else color
                marks.append((label, scores.ms_per_frame, rms_codes(psnr), color, filling))
    return marks


def _dress(axes: Any, metrics: MetricsModel, marks: list[tuple[str, float, float, str, str]]) -> None:
    from matplotlib.ticker import FuncFormatter, NullFormatter

    axes.set_xscale("log")
    if marks:
        axes.set_xlim(min(mark[1] for mark in marks) / 2.0, max(mark[1] for mark in marks) * 3.0)
        axes.set_ylim(0.0, max(mark[2] for mark in marks) * 1.25 + 0.1)
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())
    size = f"{metrics.protocol.timing_width} × {metrics.protocol.timing_height}"
    axes.set_xlabel(f"milliseconds a frame of {size}", color=MUTED)
    axes.set_ylabel("RMS error, 8-bit codes", color=MUTED)
    axes.grid(True, color=GRID, linewidth=0.8)
    axes.grid(True, which="minor", axis="x", color=GRID, linewidth=0.4)
    axes.set_axisbelow(True)
    axes.tick_params(colors=MUTED, length=0, which="both")
    for side in ("top", "right", "left"):
        axes.spines[side].set_visible(False)
    axes.spines["bottom"].set_color(GRID)


def _draw(axes: Any, marks: list[tuple[str, float, float, str, str]]) -> None:
    """Draw marks and labels, every label where it covers no mark and no earlier label if there is such a place."""
    centers = [tuple(axes.transData.transform((x, y))) for _, x, y, _, _ in marks]
    taken: list[Box] = [(x - 6, y - 6, x + 6, y + 6) for x, y in centers]
    for (label, x, y, color, filling), center in zip(marks, centers):
        axes.plot([x], [y], "o", markersize=9, markeredgecolor=color, markerfacecolor=filling, markeredgewidth=1.6)
        dx, dy, side = min(PLACES, key=lambda place: _overlap(_label_box(label, center, place), taken))
        taken.append(_label_box(label, center, (dx, dy, side)))
        axes.annotate(
            label, (x, y), (dx, dy), textcoords="offset points", ha=side, va="center", fontsize=9.5, color=INK
        )


def _label_box(label: str, center: tuple[float, ...], place: tuple[int, int, str]) -> Box:
    width = _LETTER * max(map(len, label.split("\n")))
    x, y = center[0] + place[0], center[1] + place[1]
    left = x - {"left": 0.0, "center": 0.5, "right": 1.0}[place[2]] * width
    return left, y - _LABEL_HEIGHT / 2, left + width, y + _LABEL_HEIGHT / 2


def _overlap(box: Box, others: list[Box]) -> float:
    """Return the area that `box` shares with `others`."""
    return sum(
        max(0.0, min(box[2], other[2]) - max(box[0], other[0]))
        * max(0.0, min(box[3], other[3]) - max(box[1], other[1]))
        for other in others
    )
