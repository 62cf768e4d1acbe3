"""The stages that come with ibrpipe read what they should; other packages add theirs, and bad ones are told."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path

import pytest
from click.testing import CliRunner

from ibrpipe.cli.main import cli
from ibrpipe.engine.artifacts import input_fields, needs, products, sources
from ibrpipe.errors import ConfigError
from ibrpipe.io.views import IN_RUN
from ibrpipe.stages import registry
from ibrpipe.stages.registry import load_stage, load_stages, register, registered

ORDER = [
    "calibrate",
    "ingest",
    "geometry",
    "photometry",
    "plan",
    "layers",
    "residuals",
    "asset",
    "compress",
    "render",
    "evaluate",
]
#: input -> where it is in a run folder
PLACES = {
    "calibration": "calibrate",
    "views": "photometry/views.json",  # for all stages after it
    "audit": "ingest/audit.json",
    "given": "ingest/mesh.ply",
    "points": "ingest/points.npz",
    "mesh": "geometry/mesh.ply",
    "geometry": "geometry/geometry.json",
    "dense": "geometry/dense",
    "plan": "plan/plan.json",
    "sides": "plan/sides.npz",
    "layers": "layers",
    "residuals": "residuals",
    "asset": "asset",  # for all stages after it
    "frames": "render",
}
NEEDS = {
    "calibrate": ("capture",),
    "ingest": ("capture", "calibrate"),
    "geometry": ("ingest",),
    "photometry": ("ingest", "geometry"),
    "plan": ("geometry", "photometry"),
    "layers": ("geometry", "photometry", "plan"),
    "residuals": ("geometry", "photometry", "plan", "layers"),
    "asset": ("geometry", "photometry", "plan", "layers", "residuals"),
    "compress": ("photometry", "asset"),
    "render": ("photometry", "compress"),
    "evaluate": ("calibrate", "ingest", "geometry", "photometry", "plan", "compress", "render"),
}
MODULE = """
from dataclasses import dataclass
from pathlib import Path
from ibrpipe.config import StageConfig
from ibrpipe.engine.stage import Stage, StageOutputs, artifact

class Config(StageConfig):
    pass

@dataclass(frozen=True)
class Inputs:
    asset: Path
    out: Path

@dataclass(frozen=True)
class Outputs(StageOutputs):
    asset: Path = artifact("small", "A smaller asset.")

def run(inputs, config):
    return Outputs.below(inputs.out)

STAGE = Stage("shrink", "Shrink the asset.", Inputs, Outputs, Config, run, "ibrpipe shrink --out out")
OTHER = 3
"""


@pytest.fixture
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder that Python imports from; what it registers is forgotten afterwards."""
    import_module("ibrpipe.cli.run")  # its choices of stages are made on import
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(registry, "_STAGES", dict(registry._STAGES))
    registry._entry_points.cache_clear()
    (tmp_path / "shrinking.py").write_text(MODULE)
    yield tmp_path
    registry._entry_points.cache_clear()
    sys.modules.pop("shrinking", None)


def install(site: Path, *points: str, package: str = "shrinker") -> None:
    """Write what an installed package with such entry points leaves."""
    folder = site / f"{package}-1.0.dist-info"
    folder.mkdir()
    (folder / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package}\nVersion: 1.0\n")
    (folder / "entry_points.txt").write_text("[ibrpipe.stages]\n" + "\n".join(points) + "\n")


def test_the_stages_of_ibrpipe_in_order() -> None:
    assert list(registered()) == ORDER
    assert [stage.name for stage in load_stages()] == ORDER


@pytest.mark.parametrize("name", ORDER)
def test_every_input_has_its_place(name: str) -> None:
    stages = load_stages()
    stage = next(each for each in stages if each.name == name)
    found = {key: source.path for key, source in sources(stage, stages).items()}
    places = PLACES | ({"asset": "assembled"} if name == "compress" else {})
    places |= {"views": "ingest/views.json"} if name in ("geometry", "photometry") else {}
    assert found == {key: places[key] for key in input_fields(stage) if key not in ("capture", "run", "seed")}
    assert needs(stage, stages) == NEEDS[name]


def test_a_registered_stage_stands_where_it_belongs(site: Path) -> None:
    register("shrink", "shrinking:STAGE", "Shrink the asset.")
    assert list(registered()) == [*ORDER, "shrink"]
    assert "shrinking" not in sys.modules
    stages = load_stages()
    at = ORDER.index("render")
    assert [stage.name for stage in stages] == [*ORDER[:at], "shrink", *ORDER[at:]]
    assert {sources(stage, stages)["asset"].path for stage in stages[-2:]} == {"shrink/small"}
    assert sources(stages[at], stages)["asset"].path == "asset"


def test_a_package_brings_a_stage(site: Path) -> None:
    install(site, "shrink = shrinking:STAGE")
    listed = CliRunner().invoke(cli, ["--help"])
    assert "shrink      Stage of the package shrinker." in listed.output
    assert "shrinking" not in sys.modules
    assert [stage.name for stage in load_stages()].index("shrink") == ORDER.index("render")
    told = CliRunner().invoke(cli, ["render", "--help"])
    assert "[default: shrink/small in the run folder]" in " ".join(told.output.split())


@pytest.mark.parametrize(
    ("point", "message"),
    [
        (
            "shrink = nowhere_at_all:STAGE",
            "shrink at nowhere_at_all:STAGE cannot be used: ModuleNotFoundError: No module",
        ),
        ("shrink = shrinking:NONE", "AttributeError: module 'shrinking' has no attribute 'NONE'"),
        ("shrink = shrinking:OTHER", "expected a Stage, got int"),
        ("grow = shrinking:STAGE", 'it calls itself "shrink"'),
    ],
)
def test_a_broken_package_is_told_in_one_line(site: Path, point: str, message: str) -> None:
    install(site, point)
    with pytest.raises(ConfigError) as caught:
        load_stages()
    assert message in str(caught.value)
    assert str(caught.value).endswith("; update or uninstall the package shrinker")
    assert CliRunner().invoke(cli, ["--help"]).exit_code == 0
    result = CliRunner().invoke(cli, ["run", "mesh", "--out", str(site / "out")])
    assert result.exit_code == 1
    assert result.stderr.count("\n") == 1


def test_names_are_taken_once(site: Path) -> None:
    with pytest.raises(ConfigError, match='there is a stage "plan" already; choose another name'):
        register("plan", "shrinking:STAGE", "")
    for name in ("seed", "name", "My Stage"):
        with pytest.raises(ConfigError, match="cannot be the name of a stage"):
            register(name, "shrinking:STAGE", "")
    with pytest.raises(ConfigError, match='there is no stage "plann"; did you mean "plan"'):
        load_stage("plann")


def test_a_package_cannot_take_a_name(site: Path) -> None:
    install(site, "plan = shrinking:STAGE")
    assert registered()["plan"].package == ""
    assert CliRunner().invoke(cli, ["--help"]).exit_code == 0
    with pytest.raises(ConfigError, match='"plan" already, as the package shrinker wants it; choose another name'):
        load_stages()


def test_the_views_of_a_run_lie_where_readers_without_stages_look_for_them():
    assert tuple(products(load_stages()[:count])["views"].path for count in (None, 3)) == IN_RUN
