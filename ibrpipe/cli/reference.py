"""The page docs/cli.md, made of the commands' own help."""

from __future__ import annotations

import click

from ibrpipe.cli.main import cli

_WIDTH = 100
_HEAD = """# Command line

Written by `make docs` from the commands' own help; do not edit. Every command ends with exit code 0, with 1 after a
failure told in one line, with 2 after a wrong use of the command, and with 130 after Ctrl-C; none of them leaves
anything half-written. Progress goes to stderr: bars with the time left on a terminal, a few plain lines in a log.
"""


def reference() -> str:
    """Return the page as Markdown."""
    settings = {**cli.context_settings, "terminal_width": _WIDTH, "max_content_width": _WIDTH}
    top = click.Context(cli, info_name="ibrpipe", **settings)  # the settings that a call has, -h among them
    parts = [_HEAD, _section("ibrpipe", cli.get_help(top))]
    for name in cli.list_commands(top):
        command = cli.get_command(top, name)
        if command is not None:
            context = click.Context(
                command, info_name=name, parent=top, terminal_width=_WIDTH, max_content_width=_WIDTH
            )
            parts.append(_section(f"ibrpipe {name}", command.get_help(context)))
            if isinstance(command, click.Group):
                parts += _below(command, context, f"ibrpipe {name}")
    return "\n".join(parts)


def _below(group: click.Group, parent: click.Context, title: str) -> list[str]:
    """Return the sections of the commands of a group."""
    sections = []
    for name in group.list_commands(parent):
        command = group.get_command(parent, name)
        if command is not None:
            context = click.Context(
                command, info_name=name, parent=parent, terminal_width=_WIDTH, max_content_width=_WIDTH
            )
            sections.append(_section(f"{title} {name}", command.get_help(context)))
    return sections


def _section(title: str, text: str) -> str:
    lines = "\n".join(line.rstrip() for line in text.splitlines())
    return f"## {title}\n\n```text\n{lines}\n```\n"
