"""``ibrpipe demo``: the whole job on a capture that comes out of the program itself."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import click

from ibrpipe.cli.figures import print_table, score_table
from ibrpipe.cli.options import PATH, example, json_option, workers_option
from ibrpipe.cli.run import run_shown, summary
from ibrpipe.cli.show import display
from ibrpipe.cli.synth import made
from ibrpipe.engine.artifacts import paths_below, products
from ibrpipe.engine.event_words import size
from ibrpipe.engine.executor import executor
from ibrpipe.engine.pipeline_file import load_pipeline
from ibrpipe.engine.run_folder import only_run
from ibrpipe.engine.runner import Run
from ibrpipe.evaluation.metrics import read_metrics
from ibrpipe.stages.registry import load_stages
from ibrpipe.synthetic.capture import TINY, SynthConfig


@click.command(name="demo", epilog=example("ibrpipe demo --out demo"))
@click.option("--out", type=PATH, metavar="DIR", default="demo", show_default=True, help="Folder to write.")
@click.option("--small", is_flag=True, help="A few small photos: to see in seconds that everything works.")
@click.pass_context
def command(ctx: click.Context, out: Path, small: bool, **shared: Any) -> None:
    """Photograph a synthetic glossy object, make an asset of the photos, and measure it on views held out.

    Takes under two minutes on two cores. A second call only does what is not there yet.
    """
    pipeline = load_pipeline(Path("demo-small" if small else "demo"), load_stages())
    photos = TINY if small else SynthConfig()
    capture = out / "capture"
    with executor(shared["workers"]), display() as shown, only_run(out):
        made("glossy", capture, photos.model_copy(update={"seed": pipeline.seed}), shown)
    done = run_shown(Run(pipeline, out, capture), shared["workers"], None)
    if shared["as_json"]:
        click.echo(json.dumps(summary(out, done), indent=2))
        return
    paths = paths_below(out, products(load_stages()))
    metrics = read_metrics(paths["metrics"])
    print_table(score_table(metrics))
    click.echo("size: " + ", ".join(f"{name} {size(count)}" for name, count in metrics.bytes.items()))
    click.echo(f"report: {paths['report'].resolve()}")


command.params += [workers_option, json_option]
