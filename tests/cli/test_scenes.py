"""Scenes on the command line: generated, inspected, and what is told of wrong calls."""

from __future__ import annotations

import json

import pytest
from click.testing import CliRunner

import ibrpipe
from ibrpipe.cli.main import cli
from ibrpipe.synthetic.instanced.forest import forest


def call(*args):
    return CliRunner().invoke(cli, [str(each) for each in args])


def test_a_forest_is_written_and_inspected(tmp_path):
    made = call("synth", "forest", tmp_path / "wood", "--trees", 7, "--seed", 3, "--species", "oak")
    assert made.exit_code == 0, made.output
    assert "6 parts, 12,699 sub-objects, 209,106 polygons" in made.stdout
    wanted = forest(7, 3, ("oak",)).parts["forest"].children[0].matrices
    found = ibrpipe.read_scene(tmp_path / "wood")
    assert (found.parts["forest"].children[0].matrices == wanted).all()
    facts = json.loads(call("inspect", tmp_path / "wood", "--json").stdout)
    assert (facts["kind"], facts["root"], facts["polygons"]) == ("scene", "forest", 7 * 29872 + 2)
    assert facts["parts"]["oak-cluster"]["instances"] == 7 * 7 * 6**3
    assert facts["parts"]["oak-tree"]["sub_objects"] == 1814
    assert facts["bytes"] == sum(path.stat().st_size for path in (tmp_path / "wood").rglob("*") if path.is_file())
    assert "oak-cluster" in call("inspect", tmp_path / "wood" / "scene.yaml").stdout


@pytest.mark.parametrize(
    ("args", "message"),
    [
        (["forest", "x", "--blocks", "2"], "scene forest has no --blocks; leave it out"),
        (["glossy", "x", "--trees", "2"], "scene glossy has no --trees; leave it out"),
        (["solids", "x", "--seed", "2"], "scene solids has no --seed; leave it out"),
        (["forest", "x", "--trees", "0"], "0 is not in the range"),
        (["forest", "x", "--species", "mapel"], "there is no species 'mapel'; did you mean \"maple\"?"),
    ],
)
def test_wrong_settings_of_scenes_are_told(args, message):
    result = call("synth", *args)
    assert (result.exit_code, message in result.stderr) == (2, True), result.output


def test_a_folder_with_other_things_is_left_alone(tmp_path):
    (tmp_path / "note.txt").write_text("mine")
    result = call("synth", "solids", tmp_path)
    assert result.exit_code == 1
    assert "holds files but no scene that ibrpipe wrote" in result.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["note.txt"]
