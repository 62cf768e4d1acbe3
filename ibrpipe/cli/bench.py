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
    epilog=example("ibrpipe bench hard-cases --out bench", "ibrpipe bench speed-error --out bench"),
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


@command.command(
    name="speed-error",
    epilog=example("ibrpipe bench speed-error", "ibrpipe bench speed-error --mesh bunny.ply --renderers ldi"),
)
@click.option("--out", type=PATH, metavar="DIR", default="bench", show_default=True, help="Folder to write.")
@click.option(
    "--renderers", multiple=True, metavar="NAME", help="A renderer or one of its settings; may be given several times."
)
@click.option("--mesh", type=PATH, metavar="PATH", help="A further object: PLY, OBJ, GLB/glTF or STL.")
@click.option("--quick", is_flag=True, help="Small sizes and few repeats: under a minute.")
def speed_error(out: Path, renderers: tuple[str, ...], mesh: Path | None, quick: bool, as_json: bool) -> None:
    """Time all renderers, their settings and two peers in one interleaved run, and measure their errors.

    Height fields and objects of growing size; writes speed_error.json and speed_error.html, which says which renderer
    to use when. Takes about ten minutes on two cores.
    """
    from ibrpipe.bench.report import write_speed_page
    from ibrpipe.bench.settings import choose_settings
    from ibrpipe.bench.speed_error import FULL, QUICK, run_speed_error
    from ibrpipe.io.manifest import write_json
    from ibrpipe.io.meshes import read_mesh

    settings = choose_settings(renderers)
    given = (mesh.stem, read_mesh(mesh)) if mesh else None
    out.mkdir(parents=True, exist_ok=True)
    with display():
        run = run_speed_error(settings, QUICK if quick else FULL, given)
    write_json(out / "speed_error.json", run.model.model_dump(mode="json"))
    write_speed_page(out / "speed_error.html", run)
    if as_json:
        click.echo(json.dumps(run.model.model_dump(mode="json"), indent=2))
        return
    print_table(facts_table("who is fastest", _winners(run.model)))
    click.echo(f"report: {(out / 'speed_error.html').resolve()}")


speed_error.params.append(json_option)


def _winners(model: Any) -> dict[str, str]:
    from ibrpipe.bench.report.speed_page import summary

    return {f"{row['need']} ({row['kind']}s)": f"{row['wins']} of {row['of']}" for row in summary(model)}


def _summary(model: Any) -> dict[str, str]:
    found = {}
    for name in [setting.label for setting in model.settings] + ["load"]:
        cells = [cell for cell in model.cells if cell.setting == name]
        counts = {status: sum(cell.status == status for cell in cells) for status in ("pass", "fail", "refused")}
        found[name] = f"{counts['pass']} pass, {counts['fail']} fail, {counts['refused']} refused"
    return found
