"""``ibrpipe export``: an asset or a scene in a form that other programs open."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click

from ibrpipe.cli.completion import export_forms, export_settings
from ibrpipe.cli.options import PATH, example
from ibrpipe.cli.show import display
from ibrpipe.config import StageConfig
from ibrpipe.errors import ConfigError
from ibrpipe.export.registry import Exporter, exporter_for, known_exporters
from ibrpipe.io.yaml_settings import Settings, validated, value_of


@click.command(
    name="export",
    epilog=example(
        "ibrpipe export out page.html",
        "ibrpipe export out vase.glb --set tolerance=2 --set texture=webp",
        "ibrpipe export out transforms.json",
        "ibrpipe export scenes/forest out/impostors --format impostors",
    ),
)
@click.argument("source", metavar="RUN|ASSET|CAPTURE|SCENE", type=PATH)
@click.argument("target", metavar="TARGET", type=PATH)
@click.option(
    "--format",
    "form",
    metavar="NAME",
    help=f"{', '.join(known_exporters())}; by itself where TARGET's ending says it.",
    shell_complete=export_forms,
)
@click.option("--notes", metavar="FILE", type=PATH, help="page: YAML file with title, credit, licence, annotations.")
@click.option(
    "--set",
    "changes",
    multiple=True,
    metavar="KEY=VALUE",
    help="A setting of the form; may be repeated.",
    shell_complete=export_settings,
)
def command(source: Path, target: Path, form: str | None, notes: Path | None, changes: tuple[str, ...]) -> None:
    """Write the asset of a run folder, an asset folder, a capture, or a scene to TARGET in another form.

    page: one web page, TARGET.html, that shows the asset, or a capture, from all sides in any browser.

    glb: a mesh with an atlas as TARGET.glb, for browsers, Blender, engines; tells how many dB it loses. Settings:
    tolerance, material (unlit, lit), texture (png, webp), quality, measure.

    obj: the same mesh as TARGET.obj with .mtl and .png beside it. Setting: tolerance.

    usdz: the same mesh as one file for augmented reality on Apple's devices. Setting: tolerance.

    ply: TARGET.ply, a mesh with colours at its vertices, or points with colours, normals and confidence. Setting:
    content (mesh, points).

    transforms, colmap: the photos' cameras of a run folder as transforms.json or as a COLMAP text model in a folder
    colmap.

    deep-exr: an asset folder whose layers are deep OpenEXR, which deep-aware compositors open.

    impostors: of an asset, or for every part that a scene holds copies of, a folder: albedo, normals, depth and
    coverage from 64 directions on an octahedron and from six sides, as game engines draw them.
    """
    exporter = exporter_for(target, form)
    if notes is not None and not exporter.takes_notes:
        raise ConfigError(f"--notes {notes}: the form {exporter.name} has no place for notes; leave it out")
    options = [] if exporter.Options is None else [settings_of(exporter, changes)]
    if changes and not options:
        raise ConfigError(f"--set {changes[0]}: the form {exporter.name} has no settings; leave it out")
    given = asset_of(source) if exporter.takes == "asset" else source
    with display():
        told = exporter.write(given, target, *([] if notes is None else [notes]), *options)
    click.echo(f"{target}: {exporter.name} of {source}")
    if told:
        click.echo(told)


def settings_of(exporter: Exporter, changes: Sequence[str]) -> StageConfig:
    """Return the settings of a form with ``KEY=VALUE`` in place; a wrong one is a wrong call."""
    assert exporter.Options is not None
    values: dict[str, Any] = {}
    try:
        for change in changes:
            key, equals, text = change.partition("=")
            if not equals:
                raise ConfigError(f"--set {change}: expected KEY=VALUE, such as tolerance=2")
            values[key] = value_of(text, f"--set {key}")
        return validated(
            exporter.Options, Settings(values, {(): "--set", **{(key,): f"--set {key}" for key in values}})
        )
    except ConfigError as error:
        raise click.UsageError(str(error)) from error


def asset_of(path: Path) -> Path:
    """Return the asset folder that `path` is, or that of the run folder that it is; stages of others count."""
    from ibrpipe.engine.artifacts import products, sources
    from ibrpipe.export.asset_folders import asset_folder
    from ibrpipe.stages.registry import load_stage, load_stages

    stages = load_stages()
    uncompressed = sources(load_stage("compress"), stages)["asset"]
    return asset_folder(path, (products(stages)["asset"].path, uncompressed.path))
