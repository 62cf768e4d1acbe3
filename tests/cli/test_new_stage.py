"""The page "A new stage" is true: a stage made by following it has its command, its keys, its schema, and runs."""

from __future__ import annotations

import json
import re
import sys
import tomllib
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

import ibrpipe
from ibrpipe.cli.main import cli
from ibrpipe.engine.pipeline_file import load_pipeline, packaged_pipelines
from ibrpipe.engine.runner import Run, run_pipeline
from ibrpipe.io.manifest import read_manifest
from ibrpipe.io.surfaces.meshes import write_mesh
from ibrpipe.stages import registry
from ibrpipe.stages.registry import load_stages
from ibrpipe.types import Mesh

PAGE = (Path(ibrpipe.__file__).parent.parent / "docs/new-stage.md").read_text(encoding="utf-8")
MODULE, REGISTRATION = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
(ENTRY_POINT,) = (tomllib.loads(block) for block in re.findall(r"```toml\n(.*?)```", PAGE, re.DOTALL))


@pytest.fixture(params=["call", "entry point"])
def counting(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """The page's module and its registration, either way; forgotten afterwards."""
    import_module("ibrpipe.cli.run")  # its choices of stages are made on import
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(registry, "_STAGES", dict(registry._STAGES))
    (tmp_path / "counting.py").write_text(MODULE)
    if request.param == "call":
        exec(REGISTRATION, {})
    else:
        install(tmp_path)
    registry._entry_points.cache_clear()
    yield
    registry._entry_points.cache_clear()
    sys.modules.pop("counting", None)


def install(site: Path) -> None:
    """Write what an installed package with the page's entry point leaves."""
    ((group, points),) = ENTRY_POINT["project"]["entry-points"].items()
    folder = site / "counting-1.dist-info"
    folder.mkdir()
    (folder / "METADATA").write_text("Metadata-Version: 2.1\nName: counting\nVersion: 1\n")
    lines = [f"{name} = {where}" for name, where in points.items()]
    (folder / "entry_points.txt").write_text("\n".join([f"[{group}]", *lines, ""]))


def call(*args: object) -> Result:
    result = CliRunner().invoke(cli, [str(arg) for arg in args])
    assert result.exit_code == 0, result.output
    return result


def test_it_is_listed_and_has_help(counting: None) -> None:
    assert re.search(r"^  count +(Count the vertices of the mesh|Stage of the package counting)\.$",
                     call("--help").stdout, re.MULTILINE)  # fmt: skip
    told = " ".join(call("count", "--help").stdout.split())
    assert "Mesh of the object (PLY). [default: geometry/mesh.ply in the run folder]" in told
    assert "--unit INTEGER RANGE Vertices that count as one [default: 1; 1<=x<=1000]" in told


def test_its_settings_are_keys_of_pipeline_files_and_of_the_schema(counting: None) -> None:
    stages = load_stages()
    assert [stage.name for stage in stages][2:5] == ["geometry", "count", "photometry"]
    pipeline = load_pipeline(packaged_pipelines()["mesh"], stages, ["count.unit=3"])
    assert pipeline.configs["count"].model_dump() == {"unit": 3}
    schema = json.loads(call("schema", "pipeline").stdout)
    assert schema["$defs"]["CountConfig"]["properties"]["unit"]["maximum"] == 1000
    assert json.loads(call("schema", "counts").stdout)["properties"]["vertices"]["minimum"] == 0


def test_it_runs(counting: None, tmp_path: Path) -> None:
    (tmp_path / "out/geometry").mkdir(parents=True)
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    write_mesh(Mesh(corners, np.array([[0, 2, 1], [0, 1, 3]], np.int32)), tmp_path / "out/geometry/mesh.ply")
    call("count", "--out", tmp_path / "out", "--unit", 2)
    assert json.loads((tmp_path / "out/count/counts.json").read_text()) == {"vertices": 2}
    manifest = read_manifest(tmp_path / "out/count")
    assert manifest is not None
    assert manifest.config == {"unit": 2}
    assert set(manifest.inputs) == {"mesh"}
    (tmp_path / "capture").mkdir()
    pipeline = load_pipeline(packaged_pipelines()["mesh"], load_stages(), ["count.unit=3"])
    run = Run(pipeline, tmp_path / "out", tmp_path / "capture", "count", "count")
    events: list[str] = []
    for _ in range(2):
        run_pipeline(run, load_stages(), lambda event: events.append(event.kind))
    assert events == ["starts", "done", "skipped"]
    assert json.loads((tmp_path / "out/count/counts.json").read_text()) == {"vertices": 1}
