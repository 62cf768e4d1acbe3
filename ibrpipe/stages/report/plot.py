"""The plot of speed against error, as SVG text."""

from __future__ import annotations

import io
from typing import Any

from ibrpipe.stages.metrics import MetricsModel, Scores

INK, MUTED, GRID = "#1d2329", "#6b747d", "#e4e4df"
ASSET, BASELINE = "#0b6e8f", "#a9562b"


def speed_error_plot(metrics: MetricsModel) -> str:
    """Draw milliseconds a frame (logarithmic) against the root mean square error in 8-bit codes; ``<svg ...>``."""
    from matplotlib import rc_context
    from matplotlib.backends.backend_svg import FigureCanvasSVG
    from matplotlib.figure import Figure

    with rc_context({"svg.fonttype": "none", "svg.hashsalt": "ibrpipe", "font.family": "sans-serif"}):
        figure = Figure(figsize=(7.6, 4.0), layout="constrained")
        axes = figure.add_subplot()
        for name, scores in metrics.renderers.items():
            _mark(axes, name, scores, ASSET, filled=True)
        for name, scores in metrics.baselines.items():
            _mark(axes, name, scores, BASELINE, filled=name != "mesh")
        _dress(axes, metrics)
        target = io.StringIO()
        FigureCanvasSVG(figure).print_svg(
            target, metadata={"Creator": None, "Date": None, "Format": None, "Type": None}
        )
    text = target.getvalue()
    return text[text.index("<svg") :]


def rms_codes(psnr: float) -> float:
    """Return the root mean square error in 8-bit codes that a PSNR stands for."""
    return 255.0 * 10.0 ** (-psnr / 20.0)


def _mark(axes: Any, name: str, scores: Scores, color: str, filled: bool) -> None:
    if scores.psnr is None or scores.ms_per_frame is None:
        return
    x, y = scores.ms_per_frame, rms_codes(scores.psnr)
    axes.plot([x], [y], "o", markersize=9, markeredgecolor=color, markerfacecolor=color if filled else "white", mew=1.6)
    axes.annotate(
        f"{name}\n{x:.3g} ms, {scores.psnr:.1f} dB",
        (x, y),
        xytext=(10, 0),
        textcoords="offset points",
        va="center",
        fontsize=9.5,
        color=INK,
        linespacing=1.35,
    )


def _dress(axes: Any, metrics: MetricsModel) -> None:
    from matplotlib.ticker import FuncFormatter, NullFormatter

    everyone = [*metrics.renderers.values(), *metrics.baselines.values()]
    times = [scores.ms_per_frame for scores in everyone if scores.ms_per_frame is not None]
    errors = [rms_codes(scores.psnr) for scores in everyone if scores.psnr is not None]
    axes.set_xscale("log")
    if times:
        axes.set_xlim(min(times) / 1.6, max(times) * 4.0)
    if errors:
        axes.set_ylim(0.0, max(errors) * 1.25 + 0.1)
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())
    size = f"{metrics.protocol.timing_width} x {metrics.protocol.timing_height}"
    axes.set_xlabel(f"milliseconds a frame at {size} (less is better)", color=MUTED)
    axes.set_ylabel("RMS error, 8-bit codes (less is better)", color=MUTED)
    axes.grid(True, color=GRID, linewidth=0.8)
    axes.set_axisbelow(True)
    axes.tick_params(colors=MUTED, length=0, which="both")
    for side in ("top", "right", "left"):
        axes.spines[side].set_visible(False)
    axes.spines["bottom"].set_color(GRID)
