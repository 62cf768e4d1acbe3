"""Settings of depth and surface: names of earlier versions are still read, others are not."""

from __future__ import annotations

from pathlib import Path

import pytest

from ibrpipe.engine.pipeline_file import load_pipeline
from ibrpipe.errors import ConfigError
from ibrpipe.stages.geometry import GeometryConfig
from ibrpipe.stages.registry import load_stages


def load(folder: Path, text: str, *changes: str) -> GeometryConfig:
    (folder / "p.yaml").write_text(f"name: p\ngeometry:\n{text}", encoding="utf-8")
    config = load_pipeline(folder / "p.yaml", load_stages(), changes).configs["geometry"]
    assert isinstance(config, GeometryConfig)
    return config


@pytest.mark.parametrize(
    ("old", "new", "written", "value"),
    [
        ("depth.max_turn", "depth.max_normal_angle", "30.0", 30.0),
        ("surface.fill", "surface.hull_completion", "never", "never"),
        ("surface.fit_rims", "surface.silhouette_fit", "false", False),
    ],
)
def test_earlier_names_are_read(tmp_path: Path, old: str, new: str, written: str, value: object) -> None:
    (part, old_key), (_, new_key) = old.split("."), new.split(".")
    for key in (old_key, new_key):
        in_file = load(tmp_path, f"  {part}: {{{key}: {written}}}\n")
        by_change = load(tmp_path, "  memory_mb: 500\n", f"geometry.{part}.{key}={written}")
        for config in (in_file, by_change):
            assert getattr(getattr(config, part), new_key) == value
            assert old_key not in config.model_dump()[part]  # written under the new name


@pytest.mark.parametrize("key", ["filling", "fit_rim"])
def test_other_names_are_refused(tmp_path: Path, key: str) -> None:
    with pytest.raises(ConfigError, match=rf'p.yaml:3: unknown key "{key}" in geometry.surface'):
        load(tmp_path, f"  surface: {{{key}: never}}\n")


@pytest.mark.parametrize("in_file", ["fill", "hull_completion"])
@pytest.mark.parametrize("in_change", ["fill", "hull_completion"])
def test_a_change_replaces_what_the_file_says_under_either_name(tmp_path: Path, in_file: str, in_change: str) -> None:
    change = f"geometry.surface.{in_change}=always"
    assert load(tmp_path, f"  surface: {{{in_file}: never}}\n", change).surface.hull_completion == "always"
    whole = load(tmp_path, f"  surface: {{{in_file}: never}}\n", f"geometry.surface={{{in_change}: always}}")
    assert whole.surface.hull_completion == "always"


def test_a_wrong_value_under_an_earlier_name_is_told_with_its_line(tmp_path: Path) -> None:
    with pytest.raises(
        ConfigError, match=r"p.yaml:3: geometry.surface.hull_completion is 'maybe'; it should be 'auto'"
    ):
        load(tmp_path, "  surface: {fill: maybe}\n")


def test_a_setting_under_both_names_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r'p.yaml:3: "fill" is the earlier name of "hull_completion", which is set'):
        load(tmp_path, "  surface: {fill: never, hull_completion: always}\n")
