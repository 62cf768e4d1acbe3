"""``ibrpipe bench antialiasing``: error against time of several rays a pixel."""

from __future__ import annotations

import os
from pathlib import Path

import click

from ibrpipe.cli.figures import facts_table, print_table
from ibrpipe.cli.options import PATH, example
from ibrpipe.cli.show import display


@click.command(
    name="antialiasing",
    epilog=example("ibrpipe bench antialiasing out/asset", "ibrpipe bench antialiasing out/asset --json aa.json"),
)
@click.argument("asset", type=PATH, metavar="ASSET")
@click.option(
    "--path", "path", default="orbit:frames=4,elevation=20", show_default=True, help="Cameras, as `render` takes them."
)
@click.option("--width", type=click.IntRange(16, 4096), default=640, show_default=True, help="Pixels of a frame.")
@click.option("--height", type=click.IntRange(16, 4096), default=480, show_default=True, help="Pixels of a frame.")
@click.option("--renderer", default="ldi", show_default=True, help="A renderer that takes assets.")
@click.option("--repeats", type=click.IntRange(1, 100), default=5, show_default=True, help="Turns of every camera.")
@click.option("--json", "file", type=PATH, metavar="FILE", help="Write the figures here.")
def command(asset: Path, path: str, width: int, height: int, renderer: str, repeats: int, file: Path | None) -> None:
    """Draw an asset with 1, 4 and 16 rays a pixel and with several at edges alone, and compare with 256 rays a pixel.

    All are drawn in turn; times are CPU time over the number of threads.
    """
    os.environ.setdefault("OMP_WAIT_POLICY", "passive")  # threads that wait must not spin: CPU time is measured
    from ibrpipe.bench.antialiasing import run_antialiasing
    from ibrpipe.io.assets import read_asset
    from ibrpipe.io.manifest import write_json
    from ibrpipe.io.paths import camera_path
    from ibrpipe.io.views import ViewSet

    found = read_asset(asset)
    cameras = [camera.resized(width, height) for _, camera in camera_path(path, found, ViewSet((), ()))]
    with display():
        model = run_antialiasing(found, cameras, repeats, renderer)
    if file is not None:
        file.parent.mkdir(parents=True, exist_ok=True)
        write_json(file, model.model_dump(mode="json"))
    lines = {
        f"{row.samples} ({row.rays:.2f} rays a pixel)": f"{row.psnr:.2f} dB, {row.ms:.1f} ms, {row.ratio:.2f} x one ray"
        for row in model.rows
    }
    print_table(facts_table(f"against 256 rays a pixel, {width} x {height}", lines))
