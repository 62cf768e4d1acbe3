"""``ibrpipe warm-up``: compile beforehand what first frames would wait for."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import click

from ibrpipe.cli.options import example, json_option
from ibrpipe.cli.show import display
from ibrpipe.engine.event_words import duration
from ibrpipe.progress import track

Job = Callable[[], object]


@click.command(name="warm-up", epilog=example("ibrpipe warm-up"))
def command(as_json: bool) -> None:
    """Compile what the first frames of assets and relief textures need, so that they do not wait for it.

    Compiled code is kept for all environments of a user, in ~/.cache/ibrpipe or where IBRPIPE_CACHE_DIR says, until the
    source changes. Renderers of scenes and meshes, and the stages of a run, compile theirs when they are first used.
    """
    from ibrpipe.core.jit import kept_functions

    began, before = time.perf_counter(), kept_functions()
    with display():
        jobs = _jobs()
        for name in track(jobs, "warm up"):
            jobs[name]()
    seconds, (folder, count) = time.perf_counter() - began, kept_functions()
    if as_json:
        found = {"compiled": count - before[1], "kept": count, "folder": folder, "seconds": round(seconds, 2)}
        click.echo(json.dumps(found, indent=2))
        return
    place = f"kept in {folder}" if count else f"nothing can be kept in {folder}: set IBRPIPE_CACHE_DIR to a folder"
    done = f"{len(jobs)} kinds of pictures drawn in {duration(seconds)}"
    click.echo(f"{done}, {count - before[1]} functions compiled; {place}")


command.params += [json_option]


def _jobs() -> Mapping[str, Job]:
    """What is drawn, by name; those that share nothing with what is before them first compile most."""
    from ibrpipe.synthetic.small_asset import asset, relief_texture

    jobs: dict[str, Job] = {"asset that mirrors": _drawn_asset, "asset with residuals": partial(_draw, asset("spiral"))}
    jobs["asset that keeps photos"] = partial(_draw, asset("photos"))
    jobs["asset, edges smooth"] = partial(_draw, asset(), samples="adaptive")
    for renderer in ("ldi", "prewarp", "relief", "epipolar", "splat"):
        jobs[f"relief texture by {renderer}"] = partial(_draw, relief_texture(), renderer=renderer)
    return jobs


def _drawn_asset() -> None:
    """Draw an asset as it is read from files."""
    from ibrpipe.io.assets import read_asset, write_asset
    from ibrpipe.io.layer_pictures import LOSSLESS
    from ibrpipe.synthetic.small_asset import asset

    with TemporaryDirectory() as folder:
        write_asset(asset("reflection"), Path(folder) / "asset", coding=LOSSLESS)
        _draw(read_asset(Path(folder) / "asset"))


def _draw(source: object, renderer: str = "ldi", **options: object) -> None:
    """Draw a source of :mod:`ibrpipe.synthetic.small_asset` as a small picture."""
    from ibrpipe.renderers.api import render
    from ibrpipe.synthetic.small_asset import CELLS
    from ibrpipe.types import Camera

    middle = CELLS / 2
    camera = Camera.look_at((middle, middle / 2, -2.0 * CELLS), (middle, middle, 1.0), width=32, height=24)
    render(source, camera, renderer, **options)  # type: ignore[arg-type]
