"""``ibrpipe bench``: what every renderer survives, and what speed costs in error."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import click

from ibrpipe.cli.figures import facts_table, print_table
from ibrpipe.cli.options import PATH, example, json_option
from ibrpipe.cli.show import display
from ibrpipe.errors import IbrError


class FailingCells(IbrError):
    """Some cells are beyond their limits."""


@click.group(
    name="bench",
    epilog=example("ibrpipe bench hard-cases --out bench"),
)
def command() -> None:
    """Hold all renderers against the exact answer: on hard cases, and speed against error."""


@command.command(
    name="hard-cases",
    epilog=example(
        "ibrpipe bench hard-cases --out bench", "ibrpipe bench hard-cases --renderers ldi --cases 'grazing-*'"
    ),
)
@click.option("--out", type=PATH, metavar="DIR", default="bench", show_default=True, help="Folder to write.")
@click.option(
    "--renderers", multiple=True, metavar="NAME", help="A renderer or one of its settings; may be given several times."
)
@click.option(
    "--cases", multiple=True, metavar="PATTERN", help="Names of cases with * and ?, or the number of a group (1 to 9)."
)
def hard_cases(out: Path, renderers: tuple[str, ...], cases: tuple[str, ...], as_json: bool) -> None:
    """Render every hard case with every renderer and compare with float64 brute force.

    Writes hard_cases.json and hard_cases.html. Ends with exit code 1 when a cell is beyond its limit.
    """
    from ibrpipe.bench.cases import choose_cases
    from ibrpipe.bench.hard_cases import run_hard_cases
    from ibrpipe.bench.report import write_hard_page
    from ibrpipe.bench.settings import choose_settings
    from ibrpipe.io.manifest import write_json

    chosen, settings = choose_cases(cases), choose_settings(renderers)
    out.mkdir(parents=True, exist_ok=True)
    with display():
        run = run_hard_cases(chosen, settings)
    model = run.model
    write_json(out / "hard_cases.json", model.model_dump(mode="json"))
    write_hard_page(out / "hard_cases.html", run)
    if as_json:
        click.echo(json.dumps(model.model_dump(mode="json"), indent=2))
    else:
        print_table(facts_table("hard cases", _summary(model)))
        click.echo(f"report: {(out / 'hard_cases.html').resolve()}")
    if model.failing:
        first = model.failing[0]
        told = f"the first of them {first.case} with {first.setting}: {'; '.join(first.failures)}"
        beyond = f"{len(model.failing)} of {len(model.cells)} cells are beyond their limits"
        raise FailingCells(f"{beyond}, {told}; see {out / 'hard_cases.html'}")


hard_cases.params.append(json_option)


def _summary(model: Any) -> dict[str, str]:
    found = {}
    for name in [setting.label for setting in model.settings] + ["load"]:
        cells = [cell for cell in model.cells if cell.setting == name]
        counts = {status: sum(cell.status == status for cell in cells) for status in ("pass", "fail", "refused")}
        found[name] = f"{counts['pass']} pass, {counts['fail']} fail, {counts['refused']} refused"
    return found
