"""``ibrpipe view``: look at an asset in the browser."""

from __future__ import annotations

from pathlib import Path

import click

from ibrpipe.cli.export import asset_of
from ibrpipe.cli.options import PATH, example


@click.command(name="view", epilog=example("ibrpipe view out"))
@click.argument("source", metavar="RUN|ASSET", type=PATH)
@click.option("--notes", metavar="FILE", type=PATH, help="YAML file with title, credit, licence, annotations.")
@click.option("--port", metavar="N", type=click.IntRange(0, 65535), default=0, help="Port; 0 = any that is free.")
@click.option(
    "--browser/--no-browser", default=True, show_default=True, help="Open the browser, or only tell the address."
)
def command(source: Path, notes: Path | None, port: int, browser: bool) -> None:
    """Show the asset of a run folder, or an asset folder, in the browser, from all sides.

    The page is the one that `ibrpipe export` writes. It is served to this machine alone, under an address with a random
    token, until Ctrl-C.
    """
    import webbrowser

    from ibrpipe.export.page.exporter import page_of
    from ibrpipe.export.page.server import PageServer

    with PageServer(page_of(asset_of(source), notes), port) as server:
        click.echo(f"{source}: {server.address}")
        click.echo("Ctrl-C ends it.")
        if browser:
            webbrowser.open(server.address)
        try:
            server.serve_forever()
        except KeyboardInterrupt:
            click.echo()
