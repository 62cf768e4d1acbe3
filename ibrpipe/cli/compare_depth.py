"""``ibrpipe compare-depth``: how far depth maps are from the true disparity of a stereo set."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

import click

from ibrpipe.cli.options import PATH, example
from ibrpipe.errors import MissingFileError


@click.command(
    name="compare-depth",
    epilog=example("ibrpipe compare-depth runs/motorcycle/geometry/dense Motorcycle --view im0"),
)
@click.argument("dense", type=PATH)
@click.argument("stereo", type=PATH)
@click.option("--view", default=None, metavar="NAME", help="The left picture.  [default: the first by name]")
@click.option(
    "--threshold",
    "thresholds",
    type=click.FloatRange(0, min_open=True),
    multiple=True,
    default=(0.5, 1.0, 2.0, 4.0),
    show_default=True,
    help="Pixels of disparity; may be given several times.",
)
@click.option("--json", "as_json", is_flag=True, help="Print the figures as JSON on stdout.")
def command(dense: Path, stereo: Path, view: str | None, thresholds: tuple[float, ...], as_json: bool) -> None:
    """Measure the depth map of a rectified pair's left picture in the folder DENSE against the folder STEREO.

    STEREO is a Middlebury stereo set: calib.txt, and the true disparity as disp0.pfm, disp0GT.pfm or disp_left.npz.
    """
    from ibrpipe.evaluation.depth_error import disparity_error
    from ibrpipe.io.cameras.middlebury import CALIBRATION, read_calibration, read_disparity
    from ibrpipe.io.dense import read_map

    path = _depth_map(dense, view)
    error = disparity_error(read_map(path), read_calibration(stereo / CALIBRATION), read_disparity(stereo), thresholds)
    if as_json:
        click.echo(json.dumps({"map": str(path), "thresholds": thresholds, **asdict(error)}, indent=2))
        return
    click.echo(f"{path} against {stereo}: {error.pixels} pixels with true disparity")
    click.echo(f"  with depth  {100 * error.known:.1f} %, error median {error.median:.3g} px, rmse {error.rmse:.3g} px")
    for threshold, bad, lost in zip(thresholds, error.bad, error.bad_or_unknown, strict=True):
        click.echo(
            f"  bad-{threshold:g}  {100 * bad:.1f} % of those with depth; with those without, {100 * lost:.1f} % of all"
        )


def _depth_map(dense: Path, view: str | None) -> Path:
    from ibrpipe.io.dense import Workspace

    space = Workspace(dense)
    if view is not None:
        return space.depth(view)
    found = sorted(space.depth("x").parent.glob("*.geometric.bin"))
    if not found:
        raise MissingFileError(f"{dense}: holds no depth maps; expected a dense workspace such as RUN/geometry/dense")
    return found[0]
