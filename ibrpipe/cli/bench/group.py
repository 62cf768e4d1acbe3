"""``ibrpipe bench``: what every renderer survives, and what speed costs in error."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import click

from ibrpipe.cli import completion
from ibrpipe.cli.bench.antialiasing import command as antialiasing_command
from ibrpipe.cli.bench.forest import command as forest_command
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


command.add_command(forest_command)
command.add_command(antialiasing_command)


@command.command(
    name="hard-cases",
    epilog=example(
        "ibrpipe bench hard-cases --out bench", "ibrpipe bench hard-cases --renderers ldi --cases 'grazing-*'"
    ),
)
@click.option("--out", type=PATH, metavar="DIR", default="bench", show_default=True, help="Folder to write.")
@click.option(
    "--renderers",
    multiple=True,
    metavar="NAME",
    help="A renderer or one of its settings; may be given several times.",
    shell_complete=completion.renderers,
)
@click.option(
    "--cases", multiple=True, metavar="PATTERN", help="Names of cases with * and ?, or the number of a group (1 to 9)."
)
def hard_cases(out: Path, renderers: tuple[str, ...], cases: tuple[str, ...], as_json: bool) -> None:
    """Render every hard case with every renderer and compare with float64 brute force.

    Writes hard_cases.json and hard_cases.html. Ends with exit code 1 when a cell is beyond its limit.
    """
    from ibrpipe.bench.cases import choose_cases
    from ibrpipe.bench.hard_cases.file import lines_of, pack, write_hard_cases
    from ibrpipe.bench.hard_cases.run import run_hard_cases
    from ibrpipe.bench.report import write_hard_page
    from ibrpipe.bench.settings import choose_settings

    os.environ.setdefault("OMP_WAIT_POLICY", "passive")  # pictures are tiny: threads that wait must not spin
    chosen, settings = choose_cases(cases), choose_settings(renderers)
    out.mkdir(parents=True, exist_ok=True)
    with display():
        run = run_hard_cases(chosen, settings)
    model = run.model
    write_hard_cases(out / "hard_cases.json", model)
    write_hard_page(out / "hard_cases.html", run)
    if as_json:
        click.echo(lines_of(pack(model).model_dump(mode="json")))
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
    "--renderers",
    multiple=True,
    metavar="NAME",
    help="A renderer or one of its settings; may be given several times.",
    shell_complete=completion.renderers,
)
@click.option("--mesh", type=PATH, metavar="PATH", help="A further object: PLY, OBJ, GLB/glTF or STL.")
@click.option("--quick", is_flag=True, help="Small sizes and few repeats: under a minute.")
def speed_error(out: Path, renderers: tuple[str, ...], mesh: Path | None, quick: bool, as_json: bool) -> None:
    """Time all renderers, their settings and two peers in one interleaved run, and measure their errors.

    Height fields and objects of growing size; writes speed_error.json and speed_error.html, which says which renderer
    to use when. Takes about a quarter of an hour on two cores; stopped before, it leaves the figures so far in
    speed_error.partial.json.
    """
    from ibrpipe.bench.report import write_speed_page
    from ibrpipe.bench.settings import choose_settings
    from ibrpipe.bench.speed_error.run import FULL, QUICK, run_speed_error
    from ibrpipe.io.manifest import write_json
    from ibrpipe.io.surfaces.meshes import read_mesh

    settings = choose_settings(renderers, speed=True)
    given = (mesh.stem, read_mesh(mesh)) if mesh else None
    out.mkdir(parents=True, exist_ok=True)
    partial = out / "speed_error.partial.json"
    with display():
        run = run_speed_error(
            settings, QUICK if quick else FULL, given, lambda model: write_json(partial, model.model_dump(mode="json"))
        )
    write_json(out / "speed_error.json", run.model.model_dump(mode="json"))
    partial.unlink(missing_ok=True)
    write_speed_page(out / "speed_error.html", run)
    if as_json:
        click.echo(json.dumps(run.model.model_dump(mode="json"), indent=2))
        return
    print_table(facts_table("which renderer when", _winners(run.model)))
    click.echo(f"report: {(out / 'speed_error.html').resolve()}")


speed_error.params.append(json_option)


@command.command(
    name="table2",
    epilog=example("ibrpipe bench table2 --out bench", "ibrpipe bench table2 --mesh dragon.ply"),
)
@click.option("--out", type=PATH, metavar="DIR", default="bench", show_default=True, help="Folder to write.")
@click.option("--mesh", type=PATH, metavar="PATH", help="The dragon: PLY, OBJ, GLB/glTF or STL. Left out without.")
@click.option("--sizes", default="128,256,512", show_default=True, metavar="N,N,…", help="Texels and pixels a side.")
def table2(out: Path, mesh: Path | None, sizes: str, as_json: bool) -> None:
    """Time table 2 of schaufler1999 again: torus and globe (6 maps each), and a mesh of yours (16 maps).

    Maps and picture are of the same size; writes table2.json and table2.html with the growth per doubling. Takes under
    two minutes on two cores.
    """
    from ibrpipe.bench.report import write_table2_page
    from ibrpipe.bench.sizes.table2 import run_table2
    from ibrpipe.io.manifest import write_json
    from ibrpipe.io.surfaces.meshes import read_mesh

    chosen = _sizes(sizes)
    given = read_mesh(mesh) if mesh else None
    out.mkdir(parents=True, exist_ok=True)
    with display():
        run = run_table2(chosen, given)
    assert run.model is not None
    write_json(out / "table2.json", run.model.model_dump(mode="json"))
    write_table2_page(out / "table2.html", run)
    if as_json:
        click.echo(json.dumps(run.model.model_dump(mode="json"), indent=2))
        return
    print_table(facts_table("milliseconds (growth per doubling)", _table2_lines(run.model)))
    click.echo(f"report: {(out / 'table2.html').resolve()}")


table2.params.append(json_option)


@command.command(
    name="growth",
    epilog=example("ibrpipe bench growth --out bench", "ibrpipe bench growth --renderers epipolar --renderers ldi"),
)
@click.option("--out", type=PATH, metavar="DIR", default="bench", show_default=True, help="Folder to write.")
@click.option(
    "--renderers", multiple=True, metavar="NAME", default=("epipolar",), show_default=True,
    help="A renderer or one of its settings; may be given several times.",
)  # fmt: skip
@click.option("--sizes", default="128,256,512,1024,2048", show_default=True, metavar="N,N,…", help="Texels a side.")
def growth(out: Path, renderers: tuple[str, ...], sizes: str, as_json: bool) -> None:
    """Time against size for each of the nine regions of the epipole: n x n texels in a picture of n x n pixels.

    Writes growth.json and growth.html with the slopes. Takes about a minute on two cores.
    """
    from ibrpipe.bench.report import write_growth_page
    from ibrpipe.bench.settings import choose_settings
    from ibrpipe.bench.sizes.growth import run_growth
    from ibrpipe.io.manifest import write_json

    chosen, settings = _sizes(sizes), choose_settings(renderers)
    out.mkdir(parents=True, exist_ok=True)
    with display():
        model = run_growth(settings, chosen, 2.0)
    write_json(out / "growth.json", model.model_dump(mode="json"))
    write_growth_page(out / "growth.html", model)
    if as_json:
        click.echo(json.dumps(model.model_dump(mode="json"), indent=2))
        return
    lines = {f"{c.contender}, {c.series}": " ".join(f"{x:.2f}" for x in c.doublings) for c in model.growth}
    print_table(facts_table(f"factor per doubling (at most {model.most} is O(n^2))", lines))
    click.echo(f"report: {(out / 'growth.html').resolve()}")


growth.params.append(json_option)


@command.command(
    name="rate-error", epilog=example("ibrpipe bench rate-error demo --out bench", "ibrpipe bench rate-error vase cape")
)
@click.argument("runs", metavar="RUN...", type=PATH, nargs=-1, required=True)
@click.option("--out", type=PATH, metavar="DIR", default="bench", show_default=True, help="Folder to write.")
@click.option("--views", type=click.IntRange(1), default=8, show_default=True, help="Held-out views at most.")
def rate_error(runs: tuple[Path, ...], out: Path, views: int, as_json: bool) -> None:
    """Code the asset of every RUN folder in many ways: bytes against error on its held-out photos.

    The steps of `ibrpipe compress` with view dependence and without, the codings of gong-yang, and the photos
    themselves with the lumigraph; PSNR, SSIM, FLIP, seconds of decoding and milliseconds a frame. Writes
    rate_error.json and rate_error.html. Takes about two minutes a run on two cores.
    """
    from ibrpipe.bench.rate_error.run import run_rate_error
    from ibrpipe.bench.report import write_rate_page
    from ibrpipe.io.manifest import write_json

    out.mkdir(parents=True, exist_ok=True)
    with display():
        model = run_rate_error(runs, views)
    write_json(out / "rate_error.json", model.model_dump(mode="json"))
    write_rate_page(out / "rate_error.html", model)
    if as_json:
        click.echo(json.dumps(model.model_dump(mode="json"), indent=2))
        return
    for curve in model.curves:
        lines = {
            f"{point.series}, {point.label}": f"{100 * point.share:.1f} %, {point.psnr or 0:.2f} dB"
            for point in curve.points
        }
        print_table(facts_table(f"{curve.run}: share of the photos' bytes, PSNR", lines))
    click.echo(f"report: {(out / 'rate_error.html').resolve()}")


rate_error.params.append(json_option)


def _sizes(text: str) -> list[int]:
    """Return the sizes of ``128,256``; a usage error where they are no ascending numbers of at least 8."""
    try:
        sizes = [int(part) for part in text.split(",")]
    except ValueError:
        sizes = []
    if not sizes or min(sizes) < 8 or sizes != sorted(set(sizes)):
        raise click.UsageError(f"--sizes is {text!r}; give ascending whole numbers of at least 8, such as 128,256,512")
    return sizes


def _table2_lines(model: Any) -> dict[str, str]:
    found: dict[str, str] = {}
    for row in model.rows:
        name = f"{row.model}, {row.maps} maps, {row.search}"
        factor = f" ({row.growth:.2f})" if row.growth else ""
        found[name] = f"{found.get(name, '')}  {row.size}: {row.milliseconds:.1f}{factor}".strip()
    return found | {each.model: f"left out: {each.reason}" for each in model.skipped}


def _winners(model: Any) -> dict[str, str]:
    from ibrpipe.bench.report.speed_page import recommended, shown_works
    from ibrpipe.bench.speed_error.advice import NEEDS

    shown = {work.name for work in shown_works(model)}
    return {
        f"{need.title}, {row['work']}": f"{cell['winner']} {cell['time']}, {cell['cost']}".strip(" ,")
        for row in recommended(model)
        if row["work"] in shown
        for need, cell in zip(NEEDS, row["cells"], strict=True)
    }


def _summary(model: Any) -> dict[str, str]:
    found = {}
    for name in [setting.label for setting in model.settings] + ["load"]:
        cells = [cell for cell in model.cells if cell.setting == name]
        counts = {status: sum(cell.status == status for cell in cells) for status in ("pass", "fail", "refused")}
        found[name] = f"{counts['pass']} pass, {counts['fail']} fail, {counts['refused']} refused"
    return found
