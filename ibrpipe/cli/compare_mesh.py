"""``ibrpipe compare-mesh``: how far a surface is from the true one."""

from __future__ import annotations

import json
from pathlib import Path

import click

from ibrpipe.cli.options import PATH, example
from ibrpipe.cli.show import display


@click.command(
    name="compare-mesh",
    epilog=example(
        "ibrpipe compare-mesh runs/wall/geometry/mesh.ply captures/wall/mesh.ply --views runs/wall/ingest/views.json"
    ),
)
@click.argument("mesh", type=PATH)
@click.argument("truth", type=PATH)
@click.option("--views", type=PATH, metavar="FILE", help="views.json: only what two of its photos see counts.")
@click.option(
    "--threshold",
    "thresholds",
    type=click.FloatRange(0, 1, min_open=True),
    multiple=True,
    default=(0.0025, 0.005, 0.01),
    show_default=True,
    help="Distance as a share of the true surface's diagonal; may be given several times.",
)
@click.option(
    "--samples", type=click.IntRange(1000), default=60_000, show_default=True, help="Points on either surface."
)
@click.option("--json", "as_json", is_flag=True, help="Print the figures as JSON on stdout.")
def command(
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
