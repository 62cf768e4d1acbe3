"""``ibrpipe compare-depth`` and ``compare-mesh``: how far depth maps and surfaces are from true ones."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import TypeVar

import click

from ibrpipe.cli.options import PATH, example, json_option
from ibrpipe.cli.show import display
from ibrpipe.errors import MissingFileError

_Command = TypeVar("_Command", bound=Callable[..., None])


def _thresholds(kind: click.FloatRange, usual: tuple[float, ...], unit: str) -> Callable[[_Command], _Command]:
    """Add the option --threshold."""
    return click.option(
        "--threshold",
        "thresholds",
        type=kind,
        multiple=True,
        default=usual,
        show_default=True,
        help=f"{unit}; may be given several times.",
    )


@click.command(
    name="compare-depth",
    epilog=example("ibrpipe compare-depth runs/motorcycle/geometry/dense Motorcycle --view im0"),
)
@click.argument("dense", type=PATH)
@click.argument("stereo", type=PATH)
@click.option("--view", default=None, metavar="NAME", help="The left picture.  [default: the first by name]")
@_thresholds(click.FloatRange(0, min_open=True), (0.5, 1.0, 2.0, 4.0), "Pixels of disparity")
def compare_depth(dense: Path, stereo: Path, view: str | None, thresholds: tuple[float, ...], as_json: bool) -> None:
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


compare_depth.params.append(json_option)


def _depth_map(dense: Path, view: str | None) -> Path:
    from ibrpipe.io.dense import Workspace

    space = Workspace(dense)
    if view is not None:
        return space.depth(view)
    found = sorted(space.depth("x").parent.glob("*.geometric.bin"))
    if not found:
        raise MissingFileError(f"{dense}: holds no depth maps; expected a dense workspace such as RUN/geometry/dense")
    return found[0]


@click.command(
    name="compare-mesh",
    epilog=example(
        "ibrpipe compare-mesh runs/wall/geometry/mesh.ply captures/wall/mesh.ply --views runs/wall/ingest/views.json"
    ),
)
@click.argument("mesh", type=PATH)
@click.argument("truth", type=PATH)
@click.option("--views", type=PATH, metavar="FILE", help="views.json: only what two of its photos see counts.")
@_thresholds(
    click.FloatRange(0, 1, min_open=True), (0.0025, 0.005, 0.01), "Distance as a share of the true surface's diagonal"
)
@click.option(
    "--samples", type=click.IntRange(1000), default=60_000, show_default=True, help="Points on either surface."
)
def compare_mesh(
    mesh: Path, truth: Path, views: Path | None, thresholds: tuple[float, ...], samples: int, as_json: bool
) -> None:
    """Measure MESH against the mesh TRUTH: accuracy, completeness and F-score."""
    from ibrpipe.evaluation.geometry_scores import GeometryRules, filled_vertices, scores_of
    from ibrpipe.evaluation.surface_error import compare_surfaces
    from ibrpipe.io.surfaces.meshes import read_mesh
    from ibrpipe.io.views import read_views

    photos = () if views is None else read_views(views).train
    rules = GeometryRules(thresholds, samples)
    with display():
        error = compare_surfaces(read_mesh(mesh), read_mesh(truth), photos, thresholds, samples, filled_vertices(mesh))
    found = scores_of(error, truth.name, rules)
    if as_json:
        click.echo(json.dumps(found.model_dump(mode="json"), indent=2))
        return
    click.echo(f"{mesh} against {truth}, diagonal {found.diagonal:.6g} scene units")
    if photos:
        click.echo(f"  {100 * found.seen_share:.1f} % of the true surface is seen by at least two photos and counts")
    click.echo(f"  accuracy      mean {found.accuracy_mean:.6g}, median {found.accuracy_median:.6g}")
    click.echo(f"  completeness  mean {found.completeness_mean:.6g}, median {found.completeness_median:.6g}")
    for score in found.thresholds:
        click.echo(
            f"  within {100 * score.share:g} %  precision {score.precision:.4f}  recall {score.recall:.4f}  "
            f"F {score.f_score:.4f}"
            + ("" if score.f_score_seen is None else f"  (without what was filled {score.f_score_seen:.4f})")
        )


compare_mesh.params.append(json_option)
