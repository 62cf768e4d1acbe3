"""``ibrpipe view``: look at an asset or a capture in the browser."""

from __future__ import annotations

from pathlib import Path

import click

from ibrpipe.cli.options import PATH, example
from ibrpipe.cli.show import display


@click.command(name="view", epilog=example("ibrpipe view out", "ibrpipe view captures/vase", "ibrpipe view out/ingest"))
@click.argument("source", metavar="RUN|ASSET|CAPTURE", type=PATH)
@click.option("--notes", metavar="FILE", type=PATH, help="YAML file with title, credit, licence, annotations.")
@click.option("--port", metavar="N", type=click.IntRange(0, 65535), default=0, help="Port; 0 = any that is free.")
@click.option(
    "--browser/--no-browser", default=True, show_default=True, help="Open the browser, or only tell the address."
)
@click.option("--allow-outside", is_flag=True, help="Files of a capture may lie outside its folder, as in ingest.")
def command(source: Path, notes: Path | None, port: int, browser: bool, allow_outside: bool) -> None:
    """Show the asset of a run folder, an asset folder, or a capture in the browser, from all sides.

    Of a capture, a run that has no asset yet, or a run's folder ingest it shows where the photos were taken, the photos
    themselves, sparse points, and the mesh with its confidence.

    The page is the one that `ibrpipe export` writes. It is served to this machine alone, under an address with a random
    token, until Ctrl-C.
    """
    import webbrowser

    from ibrpipe.export.page.exporter import page_of
    from ibrpipe.export.page.server import PageServer

    with display():
        page = page_of(source, notes, allow_outside)
    with PageServer(page.text, port) as server:
        click.echo(f"{source}: {server.address}")
        click.echo("; ".join(filter(None, (page.told, "Ctrl-C ends it."))))
        if browser:
            webbrowser.open(server.address)
        try:
            server.serve_forever()
        except KeyboardInterrupt:
            click.echo()
