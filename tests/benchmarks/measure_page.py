"""Pages of assets in headless Chromium against the renderer `ldi`: size, error, time to the first frame, frame rate.

Run with ``python tests/benchmarks/measure_page.py RUN...`` from the repository; prints a table in Markdown. Times are
those of Chromium's software rasteriser, which has no graphics card.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import click
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from chromium import Chromium

import ibrpipe
from ibrpipe.cli.describe import bytes_below
from ibrpipe.core.color import srgb_encode, to_bytes
from ibrpipe.export.asset_folders import asset_folder
from ibrpipe.export.page.exporter import write

CAMERAS, SIZE, REPEATS = 8, (320, 240), 3
HEAD = ("run", "asset", "page", "dB mean", "dB worst", "coverage differs", "first frame", "frame")


def main(runs: list[str]) -> None:
    """Measure every run and print its row."""
    click.echo(f"| {' | '.join(HEAD)} |\n|{'---|' * len(HEAD)}")
    for run in map(Path, runs):
        with TemporaryDirectory() as folder, Chromium(Path(folder) / "profile") as browser:
            click.echo(row(run, Path(folder), browser))


def row(run: Path, folder: Path, browser: Chromium) -> str:
    """Return the row of one run."""
    write(run, folder / "page.html")
    browser.open((folder / "page.html").as_uri(), 64, 64)
    asset = ibrpipe.read_asset(asset_folder(run))
    prepared = ibrpipe.prepare(asset, "ldi")
    cameras = ibrpipe.orbit(asset, CAMERAS, elevation=20, width=SIZE[0], height=SIZE[1])
    browser.render(cameras[0])
    first = browser.evaluate("performance.now()")
    errors, differing = [], []
    for camera in cameras:
        got, want = browser.render(camera), ibrpipe.render(prepared, camera, outputs=("color", "alpha"))
        covered, shown = want.alpha > 0, got[..., 3] > 0
        off = got[..., :3].astype(float) - to_bytes(srgb_encode(want.color))
        errors.append(10 * np.log10(255**2 / max((off[covered & shown] ** 2).mean(), 1e-3)))
        differing.append((covered != shown).mean())
    frame = frame_time(browser, cameras[0])
    sizes = (bytes_below(asset_folder(run)), (folder / "page.html").stat().st_size)
    told = [run.name, *(f"{size / 1e6:.2f} MB" for size in sizes), f"{np.mean(errors):.1f}", f"{min(errors):.1f}"]
    return f"| {' | '.join([*told, f'{np.max(differing):.4%}', f'{first / 1e3:.1f} s', f'{frame:.0f} ms'])} |"


def frame_time(browser: Chromium, camera: ibrpipe.Camera) -> float:
    """Median milliseconds of a frame of `SIZE`, view dependence included, its pixels read."""
    asked = {"K": camera.K.tolist(), "cam_from_world": camera.cam_from_world.tolist()}
    asked |= {"width": camera.width, "height": camera.height}
    times = browser.evaluate(
        f"(async () => {{ const found = [], camera = {json.dumps(asked)}; for (let n = 0; n < {REPEATS}; n++) {{"
        "const begin = performance.now(); await window.ibrpipe.render(camera); found.push(performance.now() - begin); }"
        "return found; })()"
    )
    return float(np.median(times))


if __name__ == "__main__":
    main(sys.argv[1:])
