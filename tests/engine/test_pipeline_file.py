"""Pipeline files: those that come with ibrpipe load; broken ones fail with one line that names place and key."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from pydantic import Field
from setuptools import find_packages

import ibrpipe
from ibrpipe.config import StageConfig
from ibrpipe.engine.pipeline_file import find_pipeline, load_pipeline, packaged_pipelines
from ibrpipe.engine.stage import Stage, StageOutputs
from ibrpipe.errors import ConfigError, MissingFileError, closest
from ibrpipe.io.yaml_settings import Settings, parse
from ibrpipe.stages.registry import load_stages, registered

ROOT = Path(ibrpipe.__file__).parent.parent


class Box(StageConfig):
    depth: int = Field(1, ge=0, description="Depth")


class LayersConfig(StageConfig):
    bins: int = Field(64, ge=8, le=256, description="Bins")
    mode: Literal["median", "mean"] = Field("median", description="Mode")
    boxes: tuple[Box, ...] = Field((), description="Boxes")
    box: Box | None = Field(None, description="Box")


class RenderConfig(StageConfig):
    width: int | None = Field(None, ge=1, description="Width")


@dataclass(frozen=True)
class Inputs:
    out: Path


FAKES = (
    Stage("layers", "Layers.", Inputs, StageOutputs, LayersConfig, print, ""),
    Stage("render", "Render.", Inputs, StageOutputs, RenderConfig, print, ""),
)


def load(folder: Path, text: str, *changes: str) -> dict[str, StageConfig]:
    (folder / "p.yaml").write_text(text, encoding="utf-8")
    return load_pipeline(folder / "p.yaml", FAKES, changes).configs


def test_defaults_settings_and_changes(tmp_path: Path) -> None:
    loaded = load(tmp_path, "name: n\nlayers:\n  boxes: [{depth: 1}, {depth: 2}]\n  mode: mean\nrender:\n")
    assert loaded["layers"] == LayersConfig(boxes=(Box(depth=1), Box(depth=2)), mode="mean")
    assert loaded["render"] == RenderConfig()
    text = "layers: {boxes: [{depth: 1}]}\nseed: 3"
    changed = load(tmp_path, text, "layers.boxes.0.depth=5", "render.width=7", "layers.box.depth=9", "seed=4")
    assert changed["layers"] == LayersConfig(boxes=(Box(depth=5),), box=Box(depth=9))
    assert changed["render"] == RenderConfig(width=7)
    assert load(tmp_path, text, "layers.boxes=[]", "layers.mode=mean")["layers"] == LayersConfig(mode="mean")
    assert load_pipeline(tmp_path / "p.yaml", FAKES, ["seed=4"]).seed == 4


BROKEN = {
    "layers:\n  bin: 32": 'p.yaml:2: unknown key "bin" in layers; did you mean "bins"?',
    "name: x\n\nlayer:\n  bins: 32": 'p.yaml:3: unknown key "layer"; did you mean "layers"?',
    "zzz: 1": 'p.yaml:1: unknown key "zzz"; expected one of: name, seed, layers, render',
    "layers:\n  bins: 5": "p.yaml:2: layers.bins is 5; it should be greater than or equal to 8",
    "layers:\n  bins: many": "p.yaml:2: layers.bins is 'many'; it should be a valid integer",
    "layers:\n  mode: mode": "p.yaml:2: layers.mode is 'mode'; it should be 'median' or 'mean'",
    "layers:\n  boxes:\n  - depth: 1\n  - dept: 2": 'p.yaml:4: unknown key "dept" in layers.boxes.1; did you mean "dep',
    "layers:\n  box:\n    dept: 2": 'p.yaml:3: unknown key "dept" in layers.box; did you mean "depth"?',
    "layers:\n  box:\n    depth: -2": "p.yaml:3: layers.box.depth is -2; it should be greater than or equal to 0",
    "layers: 5": "p.yaml:1: layers is 5; it should be a valid dictionary or instance of LayersConfig",
    "layers:\n  bins: 1\n  bin: 2": "p.yaml:2: layers.bins is 1; it should be greater than or equal to 8 (and 1 more)",
    "layers:\n  bins: 9\n  mode: mean\n  bins: 10": 'p.yaml:4: "bins" stands here and in line 2; keep one of them',
    "layers:\n  bins: 9\n mode: mean": "p.yaml:3: not valid YAML",
    "layers: [1": "p.yaml:1: not valid YAML",
    "a\tb: {": "not valid YAML",
    "": "p.yaml:1: expected lines of the form key: value, got None",
    "- layers": "p.yaml:1: expected lines of the form key: value, got ['layers']",
    "just words": "p.yaml:1: expected lines of the form key: value, got 'just words'",
    "seed: -1": "p.yaml:1: seed is -1; it should be greater than or equal to 0",
    "seed: 1.5": "p.yaml:1: seed is 1.5; it should be a valid integer",
    "name: ''": "p.yaml:1: name is ''; it",
    "name: [1]": "p.yaml:1: name is [1]; it should be a valid string",
}


@pytest.mark.parametrize("text", BROKEN)
def test_broken_files_fail_with_the_right_line(tmp_path: Path, text: str) -> None:
    with pytest.raises(ConfigError) as caught:
        load(tmp_path, text)
    assert BROKEN[text] in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("layers.bin=1", '--set layers.bin=1: unknown key "bin" in layers; did you mean "bins"?'),
        ("layers.bins=1", "--set layers.bins=1: layers.bins is 1; it should be"),
        ("layer.bins=9", '--set layer.bins=9: unknown key "layer"; did you mean "layers"?'),
        ("layers.bins", "expected stage.key=value"),
        ("=3", "expected stage.key=value"),
        ("layers.=3", "expected stage.key=value"),
        ("layers.bins=[", "--set layers.bins=[: not valid YAML"),
        ("name.x=3", "--set name.x=3: name is 'n', which has no keys below it"),
        ("layers.boxes.3.depth=1", "expected a number from 0 to 0 to choose from the list, got '3'"),
        ("layers.boxes.a=1", "expected a number from 0 to 0 to choose from the list, got 'a'"),
    ],
)
def test_wrong_changes(tmp_path: Path, change: str, message: str) -> None:
    with pytest.raises(ConfigError) as caught:
        load(tmp_path, "name: n\nlayers:\n  boxes: [{depth: 1}]\n", change)
    assert message in str(caught.value)


def test_not_utf8(tmp_path: Path) -> None:
    (tmp_path / "p.yaml").write_bytes(b"name: \xff\xfe")
    with pytest.raises(ConfigError, match="not UTF-8"):
        load_pipeline(tmp_path / "p.yaml", FAKES)


def test_no_such_file() -> None:
    with pytest.raises(MissingFileError, match=r"no pipeline file mehs\.yaml.*did you mean \"mesh\""):
        find_pipeline(Path("mehs.yaml"))
    with pytest.raises(MissingFileError):
        find_pipeline(Path("elsewhere/mesh.yaml"))


def test_pipelines_are_found_by_name_and_by_file_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert find_pipeline(Path("mesh")) == find_pipeline(Path("pipelines/mesh.yaml")) == ROOT / "pipelines/mesh.yaml"


@pytest.mark.parametrize("name", packaged_pipelines())
def test_pipelines_that_come_with_ibrpipe_load(name: str) -> None:
    pipeline = load_pipeline(packaged_pipelines()[name], load_stages())
    assert pipeline.name == name
    assert list(pipeline.configs) == list(registered())


def test_every_setting_is_described() -> None:

    for stage in load_stages():
        for name, field in stage.config.model_fields.items():
            assert field.description, f"{stage.name}.{name}"


def test_packages_listed_are_the_packages_there_are() -> None:
    listed = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["setuptools"]["packages"]
    assert sorted(listed) == sorted([*find_packages(str(ROOT), include=["ibrpipe*"]), "ibrpipe.pipelines"])


def test_closest_name() -> None:
    assert closest("bin", ["bins", "mode"]) == 'did you mean "bins"?'
    assert closest("x", ["bins", "mode"]) == "expected one of: bins, mode"
    assert closest("x", []) == "nothing may stand here"


VALUES = st.recursive(
    st.integers() | st.booleans() | st.none() | st.text(st.characters(codec="ascii"), max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text("abcxyz", min_size=1, max_size=4), inner),
    max_leaves=8,
)


@given(values=st.dictionaries(st.text("abcxyz", min_size=1, max_size=4), VALUES))
def test_parse_returns_what_yaml_says_and_knows_every_place(values: dict[str, object]) -> None:
    if not values:
        return
    settings = parse(yaml.safe_dump(values), "f")
    assert settings.values == values
    for key in values:
        assert settings.place((key, "nowhere")).startswith("f:")
    assert Settings({}).place(("a",)) == "settings"
