"""``ibrpipe export``: an asset or a scene in a form that other programs open."""

from __future__ import annotations

from pathlib import Path

import click

from ibrpipe.cli.options import PATH, example
from ibrpipe.errors import ConfigError
from ibrpipe.export.registry import exporter_for, known_exporters


@click.command(
    name="export",
    epilog=example("ibrpipe export out page.html", "ibrpipe export scenes/forest out/impostors --format impostors"),
)
@click.argument("source", metavar="RUN|ASSET|SCENE", type=PATH)
@click.argument("target", metavar="TARGET", type=PATH)
@click.option(
    "--format", "form", metavar="NAME", help=f"{', '.join(known_exporters())}; by itself where TARGET's ending says it."
)
@click.option("--notes", metavar="FILE", type=PATH, help="page: YAML file with title, credit, licence, annotations.")
def command(source: Path, target: Path, form: str | None, notes: Path | None) -> None:
    """Write the asset of a run folder, an asset folder, or a scene to TARGET in another form.

    page: one web page, TARGET.html, that shows the asset from all sides in any browser.

    deep-exr: an asset folder whose layers are deep OpenEXR, which deep-aware compositors open.

    impostors: of a scene, a folder for every part that its root holds copies of: albedo, normals, depth and coverage
    from 64 directions on an octahedron and from six sides, as game engines draw them.
    """
    exporter = exporter_for(target, form)
    if notes is not None and not exporter.takes_notes:
        raise ConfigError(f"--notes {notes}: the form {exporter.name} has no place for notes; leave it out")
    given = asset_folder(source) if exporter.takes == "asset" else source
    exporter.write(given, target, *([] if notes is None else [notes]))
    click.echo(f"{target}: {exporter.name} of {source}")


def asset_folder(path: Path) -> Path:
    """Return the asset folder that `path` is, or the finished asset of the run folder that it is."""
    from ibrpipe.engine.artifacts import products, sources
    from ibrpipe.io.assets import INDEX
    from ibrpipe.stages.registry import load_stage, load_stages

    if (path / INDEX).is_file():
        return path
    stages = load_stages()
    finished = path / products(stages)["asset"].path
    uncompressed = path / sources(load_stage("compress"), stages)["asset"].path
    return finished if finished.is_dir() or not uncompressed.is_dir() else uncompressed
