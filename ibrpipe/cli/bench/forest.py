"""``ibrpipe bench forest``: scenes of many copies against ray casting, at equal error."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import click

from ibrpipe.cli.figures import facts_table, print_table
from ibrpipe.cli.options import PATH, example
from ibrpipe.cli.show import display


@click.command(
    name="forest",
    epilog=example(
        "ibrpipe bench forest --trees 100,1000 --json forest.json",
        "ibrpipe bench forest --trees 100,1000,10000,100000 --views far --growth growth.png",
    ),
)
@click.option("--trees", default="100,1000", show_default=True, metavar="N,N,…", help="Sizes of the forests.")
@click.option(
    "--views", default="far,middle,near", show_default=True, metavar="NAME,…", help="Cameras: far, middle, near."
)
@click.option("--seed", type=click.IntRange(0), default=5, show_default=True, help="Of the trees and their places.")
@click.option("--repeats", type=click.IntRange(1), default=5, show_default=True, help="Turns; the least time counts.")
@click.option(
    "--directions", type=click.IntRange(1, 4096), help="Views of a part; 6 = those of the paper. As usual if not given."
)
@click.option("--slab-texels", type=click.FloatRange(0.5, 64), help="Thickness of slabs. As usual if not given.")
@click.option("--finest", type=click.IntRange(2, 64), help="Texels across a part, at most. As usual if not given.")
@click.option(
    "--pixel-error",
    type=click.FloatRange(0.1, 16),
    help="Greatest width of a texel in the picture, pixels; 1 = the paper's. As usual if not given.",
)
@click.option(
    "--flight", type=click.IntRange(2), metavar="FRAMES", help="Fly over each forest: change beyond the truth's."
)
@click.option("--growth", type=PATH, metavar="FILE", help="Draw time against the number of trees: .png, .svg or .pdf.")
@click.option(
    "--tradeoff",
    type=PATH,
    metavar="FILE",
    help="Try thresholds, directions and slabs on the first forest, and draw it.",
)
@click.option("--alone", is_flag=True, help="Only our times: no peer, no errors.")
@click.option("--json", "file", type=PATH, metavar="FILE", help="Write the figures here.")
def command(
    trees: str,
    views: str,
    seed: int,
    repeats: int,
    directions: int | None,
    slab_texels: float | None,
    finest: int | None,
    pixel_error: float | None,
    flight: int | None,
    growth: Path | None,
    tradeoff: Path | None,
    alone: bool,
    file: Path | None,
) -> None:
    """Draw forests with the renderer hierarchical and with Embree's instances, in turn, and compare at equal error.

    The peer is the library inside the wheel embreex (pip install ibrpipe[peers]); without it, rows say so. Truth is the
    peer's picture with 256 samples a pixel. Times are CPU time over the number of threads. Takes about three minutes
    for the sizes that are set, on two cores.
    """
    os.environ.setdefault("OMP_WAIT_POLICY", "passive")  # threads that wait must not spin: CPU time is measured
    from ibrpipe.bench.forest.growth_plot import write_growth_plot
    from ibrpipe.bench.forest.run import run_forest
    from ibrpipe.bench.forest.tradeoff import run_tradeoff
    from ibrpipe.bench.forest.tradeoff_plot import write_tradeoff_plot
    from ibrpipe.io.manifest import write_json
    from ibrpipe.renderers.hierarchical.prefiltering import Slicing

    for option, plot in (("growth", growth), ("tradeoff", tradeoff)):
        if plot is not None and plot.suffix.lower() not in (".png", ".svg", ".pdf"):
            raise click.UsageError(f"--{option} is {str(plot)!r}; name a file that ends in .png, .svg or .pdf")
    if alone and (tradeoff or flight):
        raise click.UsageError("--alone leaves out errors, which --tradeoff and --flight are about; leave out either")
    sizes, cameras = _numbers(trees), _names(views)
    given = {"directions": directions, "slab_texels": slab_texels, "finest": finest}
    slicing = Slicing(**{name: value for name, value in given.items() if value is not None})  # type: ignore[arg-type]
    with display():
        model = run_forest(
            sizes, cameras, seed, repeats, slicing=slicing, frames=flight or 0, alone=alone, pixel_error=pixel_error
        )
        if tradeoff is not None:
            tried = run_tradeoff(sizes[0], cameras, seed, repeats)
            model = model.model_copy(update={"tradeoffs": tried})
            write_tradeoff_plot(tried, tradeoff)
    if file is not None:
        file.parent.mkdir(parents=True, exist_ok=True)
        write_json(file, model.model_dump(mode="json"))
    if growth is not None:
        write_growth_plot(model.rows, growth)
    print_table(facts_table("forest", _lines(model)))


def _numbers(text: str) -> list[int]:
    parts = [part.strip() for part in text.split(",")]
    if not all(part.isdigit() and int(part) > 0 for part in parts):
        raise click.UsageError(f"--trees is {text!r}; give whole numbers of at least 1, such as 100,1000")
    return [int(part) for part in parts]


def _names(text: str) -> list[str]:
    from ibrpipe.synthetic.instanced.forest import VIEWS

    names = [part.strip() for part in text.split(",")]
    wrong = [name for name in names if name not in VIEWS]
    if wrong:
        raise click.UsageError(f"--views names {wrong[0]!r}; choose among: {', '.join(VIEWS)}")
    return names


def _lines(model: Any) -> dict[str, str]:
    made = f"{model.library_bytes / 1e6:.0f} MB in {model.prerender_seconds:.0f} s"
    lines = {"slices": made}
    for row in model.rows:
        told = f"{row.ours_ms:.1f} ms" + ("" if row.ours_psnr is None else f", {row.ours_psnr:.1f} dB")
        if row.ratio is None:
            told += f"; {row.note}"
        else:
            told += f"; Embree {row.equal_ms:.0f} ms at this error: {row.ratio:.1f}x"
        lines[f"{row.trees} trees, {row.view}"] = told
    for flown in model.flights:
        told = f"changes by {flown.ours_rms:.2f} codes more than the truth, largest block {flown.ours_block:.2f}"
        told += f"; without any switch {flown.kept_rms:.2f}, {flown.kept_block:.2f}"
        if flown.peer_rms is not None:
            told += f"; Embree at 4 samples {flown.peer_rms:.2f}, {flown.peer_block:.2f}"
        lines[f"{flown.trees} trees, flight"] = told
    for tried in model.tradeoffs:
        told = f"{tried.ours_ms:.1f} ms, {tried.ours_psnr:.1f} dB, slices {tried.library_bytes / 1e6:.0f} MB"
        lines[f"{tried.varied} {tried.value:g}, {tried.view}"] = told
    return lines
