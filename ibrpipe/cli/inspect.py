"""``ibrpipe inspect``: what a folder holds."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import click
from rich.table import Table

from ibrpipe.cli.describe import Facts, describe
from ibrpipe.cli.figures import facts_table, print_table
from ibrpipe.cli.options import PATH, example, json_option
from ibrpipe.engine.event_words import duration, size


@click.command(
    name="inspect",
    epilog=example(
        "ibrpipe inspect captures/glossy",
        "ibrpipe inspect out/asset --json",
        "ibrpipe inspect out --against sparse/0",
        "ibrpipe inspect scenes/forest",
    ),
)
@click.argument("path", type=PATH)
@click.option("--against", type=PATH, metavar="TRUTH", help="Compare the cameras with those of this folder.")
def command(path: Path, against: Path | None, as_json: bool) -> None:
    """Say what the capture, run, asset or scene folder, views.json or glTF file at PATH holds.

    With --against, PATH and TRUTH are COLMAP models, or capture, run or calibrate folders. The cameras of PATH are
    aligned to those of TRUTH by a similarity, and what is left is told: distances in its unit, and in degrees rotations
    and the angles between rays of the same pixels (a principal point that lies aside and a turn nearly cancel there).
    """
    facts = describe(path) if against is None else _compared(path, against)
    if as_json:
        click.echo(json.dumps(facts, indent=2, ensure_ascii=False))
    else:
        print_table(*_tables(facts))


command.params.append(json_option)


def _compared(path: Path, truth: Path) -> Facts:
    from ibrpipe.calibration.compare import compare_cameras
    from ibrpipe.engine.artifacts import products
    from ibrpipe.stages.registry import load_stages

    below = products(load_stages())["calibration"].path
    found, wanted = (folder / below if (folder / below).is_dir() else folder for folder in (path, truth))
    return {"kind": "cameras", "path": str(path), "truth": str(truth), **compare_cameras(found, wanted)}


def _tables(facts: Facts) -> list[Table]:
    """Return one table of the plain facts, and one for each list or mapping of records."""
    plain = {name: value for name, value in facts.items() if name not in ("kind", "path") and not _records(value)}
    tables = [facts_table(f"{facts['kind']} {facts['path']}", {_words(k): _text(k, v) for k, v in plain.items()})]
    return tables + [_record_table(name, _records(value)) for name, value in facts.items() if _records(value)]


def _records(value: Any) -> dict[str, dict[str, Any]]:
    """Return a list or mapping of mappings as a mapping of mappings; empty for anything else."""
    if isinstance(value, list):
        value = {str(index): each for index, each in enumerate(value)}
    if isinstance(value, dict) and value and all(isinstance(each, dict) for each in value.values()):
        return value
    return {}


def _record_table(name: str, records: dict[str, dict[str, Any]]) -> Table:
    known = [key for record in records.values() for key, value in record.items() if value is not None]
    keys = list(dict.fromkeys(known))
    table = Table(title=_words(name), title_justify="left")
    table.add_column("")
    for key in keys:
        table.add_column(_words(key), justify="right")
    for label, record in records.items():
        table.add_row(label, *(_text(key, record.get(key)) for key in keys))
    return table


def _words(name: str) -> str:
    return name.replace("_", " ")


def _text(name: str, value: Any) -> str:
    """Return a value as a person reads it; the name tells bytes and seconds."""
    if value is None:
        return "-"
    if isinstance(value, (list, tuple)):
        return ", ".join(_text(name, each) for each in value) or "-"
    if isinstance(value, dict):
        return ", ".join(f"{_words(key)} {_text(f'{name}.{key}', each)}" for key, each in value.items())
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        if "bytes" in name:
            return size(value)
        return duration(value) if "seconds" in name else f"{value:.6g}"
    return str(value)
