"""Generated pages are up to date, every command is documented, links lead somewhere, examples in the docs are valid."""

from __future__ import annotations

import ast
import importlib.util
import re
import shlex
from pathlib import Path

import click
import pytest

import ibrpipe
from ibrpipe.cli.main import cli, sections

ROOT = Path(ibrpipe.__file__).parent.parent
PAGES = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md"), *ROOT.glob("data_specs/*.md")])
NAMES = [name for section in sections().values() for name in section]


def _generator() -> object:
    spec = importlib.util.spec_from_file_location("generate", ROOT / "docs/generate.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_generated_pages_are_up_to_date() -> None:
    assert _generator().stale() == [], "type: make docs"  # type: ignore[attr-defined]


@pytest.mark.parametrize("name", NAMES)
def test_every_command_is_documented(name: str) -> None:
    text = (ROOT / "docs/cli.md").read_text(encoding="utf-8")
    section = text.partition(f"## ibrpipe {name}\n")[2].partition("\n## ")[0]
    command = cli.get_command(click.Context(cli), name)
    assert command is not None
    for param in command.params:
        if isinstance(param, click.Option):
            assert param.opts[0] in section
    for below, inner in getattr(command, "commands", {}).items():
        section = text.partition(f"## ibrpipe {name} {below}\n")[2].partition("\n## ")[0]
        for param in inner.params:
            if isinstance(param, click.Option):
                assert param.opts[0] in section


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_links_lead_somewhere(page: Path) -> None:
    for target in re.findall(r"\]\(([^)#\s]+)[^)]*\)", page.read_text(encoding="utf-8")):
        if "://" not in target:
            assert (page.parent / target).exists(), f"{page.name} links to {target}"


def _examples() -> list[tuple[str, str]]:
    found = []
    for page in PAGES:
        for block in re.findall(r"```sh\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL):
            lines = [line.partition("#")[0].strip() for line in block.splitlines()]
            found += [(page.name, line) for line in lines if line.startswith("ibrpipe ")]
    return found


@pytest.mark.parametrize(("page", "line"), _examples())
def test_examples_in_the_docs_are_valid_calls(page: str, line: str) -> None:
    _parse(shlex.split(line)[1:])


@pytest.mark.parametrize("name", NAMES)
def test_examples_in_the_help_are_valid_calls(name: str) -> None:
    command = cli.get_command(click.Context(cli), name)
    assert command is not None
    assert command.epilog is not None
    for line in command.epilog.splitlines():
        if line.strip().startswith("ibrpipe "):
            _parse(shlex.split(line)[1:])


def _parse(words: list[str]) -> None:
    """Parse a call without running it; a wrong one raises click.UsageError."""
    command = cli.get_command(click.Context(cli), words[0])
    assert command is not None, f"there is no command {words[0]}"
    command.make_context(words[0], words[1:])


def test_python_examples_compile_and_name_public_things() -> None:
    for page in PAGES:
        for block in re.findall(r"```python\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL):
            for node in ast.walk(ast.parse(block)):
                if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "ibrpipe":
                    assert node.attr in ibrpipe.__all__, f"{page.name} uses ibrpipe.{node.attr}"
