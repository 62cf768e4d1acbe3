"""The command ``ibrpipe``: a group whose commands are imported when they are used, so that ``--help`` is instant."""

from __future__ import annotations

import signal
import sys
from importlib import import_module
from typing import Any, NoReturn

import click
from click.shell_completion import CompletionItem

from ibrpipe.cli.boundary import one_line
from ibrpipe.interruption import ask_to_stop, stop_if_asked
from ibrpipe.stages.registry import registered
from ibrpipe.version import VERSION

Section = dict[str, tuple[str, str]]
#: command -> (where it is, one line of help)
JOBS: Section = {
    "demo": ("ibrpipe.cli.demo:command", "Make a synthetic capture, run the pipeline on it, open the report."),
    "run": ("ibrpipe.cli.run:command", "Run a pipeline: what is out of date, in order."),
}
TOOLS: Section = {
    "bench": (
        "ibrpipe.cli.bench.group:command",
        "Hold all renderers against the exact answer.",
    ),
    "compare-depth": ("ibrpipe.cli.compare:compare_depth", "Measure depth maps against a stereo set's truth."),
    "compare-mesh": ("ibrpipe.cli.compare:compare_mesh", "Measure a surface against the true one."),
    "depth-images": (
        "ibrpipe.cli.depth_images:command",
        "Cover a mesh with few perspective depth images, as an asset.",
    ),
    "export": ("ibrpipe.cli.export:command", "Write an asset in a form that other programs open."),
    "inspect": ("ibrpipe.cli.inspect:command", "Say what a capture, a run, an asset or a scene holds."),
    "prerender": (
        "ibrpipe.cli.scenes.prerender:command",
        "Make images of a scene's parts, for the renderer hierarchical.",
    ),
    "relief": ("ibrpipe.cli.relief.group:command", "Make relief textures; map reliefs onto meshes."),
    "schema": ("ibrpipe.cli.schema:command", "Write the JSON Schemas of files on disk and of renderers' options."),
    "synth": ("ibrpipe.cli.synth:command", "Make a synthetic capture with exact truth, or a scene of many copies."),
    "view": ("ibrpipe.cli.view:command", "Show an asset in the browser, from all sides."),
    "warm-up": ("ibrpipe.cli.warm_up:command", "Compile what first frames need, so that they do not wait."),
}


def sections() -> dict[str, Section]:
    """Return all commands under their headings."""
    stages = {name: (f"ibrpipe.cli.stage:{name}", entry.summary) for name, entry in registered().items()}
    if "render" in stages:
        stages["render"] = ("ibrpipe.cli.scenes.render:command", stages["render"][1])
    return {"Whole jobs": JOBS, "Single stages": stages, "Tools": TOOLS}


class LazyGroup(click.Group):
    """A group that imports a command when it is called or its own help is asked for."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names of all commands, in the order of the help."""
        return [name for section in sections().values() for name in section]

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import and return one command."""
        for section in sections().values():
            if cmd_name in section:
                module, attribute = section[cmd_name][0].split(":")
                command: click.Command = getattr(import_module(module), attribute)
                return command
        return None

    def shell_complete(self, ctx: click.Context, incomplete: str) -> list[CompletionItem]:
        """Complete the names of commands without importing them, then the options of the group."""
        names = {name: summary for section in sections().values() for name, (_, summary) in section.items()}
        found = [CompletionItem(name, help=text) for name, text in names.items() if name.startswith(incomplete)]
        return found + click.Command.shell_complete(self, ctx, incomplete)

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Find the command; a misspelt one gets a suggestion."""
        try:
            return super().resolve_command(ctx, args)
        except click.UsageError as error:
            from ibrpipe.errors import closest

            advice = closest(args[0], self.list_commands(ctx))
            raise click.UsageError(f'there is no command "{args[0]}"; {advice}', ctx) from error

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the commands under their headings without importing them."""
        for heading, section in sections().items():
            with formatter.section(heading):
                formatter.write_dl([(name, summary) for name, (_, summary) in section.items()])

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command inside the error boundary."""
        with one_line():
            return super().invoke(ctx)


@click.group(
    cls=LazyGroup,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
    epilog="Example: ibrpipe demo",
)
@click.version_option(VERSION, prog_name="ibrpipe")
def cli() -> None:
    """Make image-based 3-D assets of photographs, render them on the CPU, and measure the error."""


def main() -> NoReturn:
    """Run the command line; the console script."""
    if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:  # jobs in the background of a shell
        signal.signal(signal.SIGINT, _stop)
    signal.signal(signal.SIGTERM, _stop)
    cli(prog_name="ibrpipe")
    sys.exit(0)


def _stop(number: int, frame: object) -> None:
    """End by the usual way out, so that nothing half-written stays; what swallows the exception meets it again."""
    ask_to_stop(number)
    stop_if_asked()
