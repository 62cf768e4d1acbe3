"""``ibrpipe schema``: the JSON Schemas of files on disk and of renderers' options, of the models that check them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import click
from pydantic import BaseModel

from ibrpipe.cli.completion import schemas
from ibrpipe.cli.options import PATH, example
from ibrpipe.errors import MissingFileError

_DIALECT = "https://json-schema.org/draft/2020-12/schema"


def models() -> dict[str, type[BaseModel]]:
    """Return every model of a file on disk, and the options of every renderer, by the name of its schema."""
    from ibrpipe.bench.antialiasing import Antialiasing
    from ibrpipe.bench.forest.results import ForestModel
    from ibrpipe.bench.hard_cases.file import HardCasesFile
    from ibrpipe.bench.rate_error.results import RateErrorModel
    from ibrpipe.bench.sizes.results import GrowthModel, Table2Model
    from ibrpipe.bench.speed_error.results import SpeedErrorModel
    from ibrpipe.engine.pipeline_file import pipeline_model
    from ibrpipe.engine.run_document import RunDocument
    from ibrpipe.io.documents.impostors import Impostors
    from ibrpipe.io.documents.prerendered import PrerenderedFile
    from ibrpipe.io.documents.reliefs import ReliefsFile
    from ibrpipe.io.documents.scene import SceneDocument
    from ibrpipe.io.manifest import Manifest
    from ibrpipe.renderers.registry import BUILT_IN, find_renderer
    from ibrpipe.stages.registry import load_stages

    stages = load_stages()
    made = [each for stage in stages for each in stage.outputs.artifacts()]
    found: dict[str, type[BaseModel]] = {Path(each.path).stem: each.document for each in made if each.document}
    found |= {
        "hard_cases": HardCasesFile,
        "manifest": Manifest,
        "reliefs": ReliefsFile,
        "run": RunDocument,
        "scene": SceneDocument,
        "impostors": Impostors,
    }
    found |= {"pipeline": pipeline_model(stages), "speed_error": SpeedErrorModel}
    found |= {
        "antialiasing": Antialiasing,
        "forest": ForestModel,
        "prerendered": PrerenderedFile,
        "rate_error": RateErrorModel,
        "growth": GrowthModel,
        "table2": Table2Model,
    }
    found |= {f"renderer_{name}": find_renderer(name).Options for name in BUILT_IN}
    return dict(sorted(found.items()))


def schema_text(name: str, model: type[BaseModel]) -> str:
    """Return the schema of one model as the text of its file."""
    schema: dict[str, Any] = {"$schema": _DIALECT, **model.model_json_schema(mode="validation")}
    schema["title"] = name
    return json.dumps(schema, indent=2, ensure_ascii=False) + "\n"


@click.command(name="schema", epilog=example("ibrpipe schema pipeline", "ibrpipe schema --out data_specs"))
@click.argument("name", required=False, shell_complete=schemas)
@click.option("--out", type=PATH, metavar="DIR", help="Write NAME.schema.json files into this folder.")
def command(name: str | None, out: Path | None) -> None:
    """Print the JSON Schema NAME, or write all of them to a folder; without either, list their names."""
    known = models()
    if name is not None and name not in known:
        from ibrpipe.errors import closest

        raise click.UsageError(f'there is no schema "{name}"; {closest(name, known)}')
    chosen = known if name is None else {name: known[name]}
    if out is not None:
        write_schemas(out, chosen)
    elif name is not None:
        click.echo(schema_text(name, known[name]), nl=False)
    else:
        click.echo("\n".join(known))


def write_schemas(folder: Path, chosen: dict[str, type[BaseModel]]) -> None:
    """Write the schemas of `chosen` into `folder`."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except FileExistsError as error:
        raise MissingFileError(f"{folder} is a file; give a folder with --out") from error
    for name, model in chosen.items():
        (folder / f"{name}.schema.json").write_text(schema_text(name, model), encoding="utf-8")
