"""First frame of an asset in a new interpreter: with an empty cache of kernels, and from the cache.

Run with ``python tests/benchmarks/measure_first_frame.py RUN...`` from the repository; prints a table in Markdown.
Processor seconds count all processes, so that other work on the machine changes them little.
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

import click

from ibrpipe.export.asset_folders import asset_folder

SIZE, REPEATS = (640, 480), 3
PROGRAM = f"""
import sys
import ibrpipe
asset = ibrpipe.read_asset(sys.argv[1])
camera = ibrpipe.orbit(asset, 1, elevation=20, width={SIZE[0]}, height={SIZE[1]})[0]
ibrpipe.render(asset, camera)
"""


def main(runs: list[str]) -> None:
    """Measure every run and print its row."""
    click.echo("| run | cold | processors, cold | cached |\n|---|---|---|---|")
    for run in map(Path, runs):
        with TemporaryDirectory() as cache:
            cold, busy = first_frame(run, cache)
            warm = min(first_frame(run, cache)[0] for _ in range(REPEATS))
        click.echo(f"| {run.name} | {cold:.1f} s | {busy:.1f} s | {warm:.1f} s |")


def first_frame(run: Path, cache: str) -> tuple[float, float]:
    """Seconds from starting the interpreter to its end, and processor seconds of it and what it starts."""
    began, before = time.perf_counter(), resource.getrusage(resource.RUSAGE_CHILDREN)
    environment = {**os.environ, "IBRPIPE_CACHE_DIR": cache}
    subprocess.run([sys.executable, "-c", PROGRAM, str(asset_folder(run))], check=True, env=environment)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.perf_counter() - began, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


if __name__ == "__main__":
    main(sys.argv[1:])
