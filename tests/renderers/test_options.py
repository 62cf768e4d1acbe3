"""Every option of every renderer: what it takes, what it refuses, and how that is told."""

from __future__ import annotations

import math

import numpy as np
import pytest
from click.testing import CliRunner

import ibrpipe
from ibrpipe.cli.main import cli
from ibrpipe.errors import RendererError
from ibrpipe.renderers.option_check import checked_options
from ibrpipe.renderers.option_text import option_table
from ibrpipe.renderers.registry import BUILT_IN, find_renderer
from ibrpipe.renderers.renderer_spec import choose

OPTIONS = [(name, option) for name in BUILT_IN for option in find_renderer(name).Options.model_fields]
#: an infinite threshold parts nothing, as its description says
ENDLESS = {("prewarp", "max_step")}
NEVER = (
    "wide", "", "1e", b"two", object(), {}, {"a": 1}, [[1, 2], [3]], [None], 1j, math.nan, -math.inf, 10**400,
    np.array(["x"]), np.array([math.nan, 0, 0]), np.zeros((2, 2, 2)), print,
)  # fmt: skip
BOUNDS = {
    ("epipolar", "search"): ("Exact", 0, True, None), ("ldi", "residuals"): (2, -1, 0.5, None),
    ("ldi", "search"): ("best", 1, None), ("epipolar", "residuals"): (2, "yes?", None),
    ("splat", "residuals"): (-1, 0.5, None),
    ("hierarchical", "mode"): ("images", True, None), ("hierarchical", "near"): (-1e-9, True, "0.5", None),
    ("hierarchical", "pixel_error"): (0.0, 0.0999, 16.1, True, "1", None),
    ("hierarchical", "occlusion"): (-1, 257, 8.0, True, "8", None), ("hierarchical", "shadows"): (2, "yes?", None),
    ("hierarchical", "shadow_size"): (63, 8193, 512.0, True, "512", None),
    ("prewarp", "depth_bits"): (0, 16, 31.5, "8", True, None),
    ("prewarp", "fallback"): (True, None), ("prewarp", "filter"): ("blur", None),
    ("prewarp", "level"): (-1, 17, 0.5, True),
    ("prewarp", "max_step"): (0, -1.0, True), ("prewarp", "method"): ("one-pass", None),
    ("prewarp", "quads"): ("four", 3), ("relief", "ambient"): (-0.1, (1, 2), (1, 2, -3), True, "0.5", None),
    ("relief", "anisotropy"): (-1, 65, 8.0, True, None), ("relief", "binary_steps"): (-1, 65, 0.5, True, None),
    ("relief", "level"): (-1, 17, 0.5, True),
    ("relief", "diffuse"): (-1, (1, 1, math.inf), None), ("relief", "least_steps"): (0, 4097, 9.5, True),
    ("relief", "light"): (1, (1, 2), (1, 2, 3, 4, 5), ("1", "2", "3"), True, np.zeros((1, 3))),
    ("relief", "linear_steps"): (0, 4097, 7.0, "7", True, None), ("relief", "mapping"): ("Relief", None),
    ("relief", "model"): ("prism", None), ("relief", "search"): ("linear", None), ("relief", "shadows"): (2, None),
    ("relief", "shininess"): (-1e-9, 1e4 + 1, True, None), ("relief", "specular"): ((), (1, 2), -2),
    ("relief", "two_sided"): (3, "both"), 
    ("relief", "vertices"): (1, (1, 2, 3), np.zeros((5, 2)), np.zeros((3, 3), bool)),
    ("splat", "footprint"): (-1e-9, 16.001, True, "2", None),
}  # fmt: skip


@pytest.mark.parametrize(("renderer", "option"), OPTIONS)
def test_wrong_values_are_told_in_one_line(renderer, option):
    shared = {"threads": (-1, 4097, 1.5, "2", True, None), "samples": (0, -4, 2, 65, 1.5, "4", "all", None)}
    wrong = [*NEVER, *(BOUNDS.get((renderer, option)) or shared[option])]
    wrong += [] if (renderer, option) in ENDLESS else [math.inf]
    for value in wrong:
        with pytest.raises(RendererError) as caught:
            checked_options(find_renderer(renderer), {option: value})
        told = str(caught.value)
        assert told.startswith(f"renderer '{renderer}': {option} is "), told
        assert "; give " in told or "; choose among: " in told, told
        assert "\n" not in told
        assert len(told) < 300, told


def test_every_option_has_bounds_that_are_tried():
    assert set(BOUNDS) | {(name, option) for name in BUILT_IN for option in ("threads", "samples")} == set(OPTIONS)


@pytest.mark.parametrize(("renderer", "option"), OPTIONS)
def test_defaults_are_sound_and_described(renderer, option):
    options = find_renderer(renderer).Options
    field = options.model_fields[option]
    assert not field.is_required()
    assert field.description
    default = getattr(options(), option)
    checked = checked_options(find_renderer(renderer), {option: default})
    assert getattr(checked, option) == default
    assert f"| `{option}` | " in option_table(options)
    assert option in options.model_json_schema()["properties"]


@pytest.mark.parametrize(
    ("renderer", "given"),
    [
        ("relief", {"linear_steps": np.int64(7), "shininess": np.float32(2), "shadows": np.bool_(False)}),
        ("relief", {"light": np.array([1, 2, 3]), "ambient": [0.1, 0.2, 0.3], "specular": 1}),
        ("relief", {"light": [0.0, 0.0, 1.0, 0.0], "vertices": [[0, 1, 2], [3, 4, 5]], "shininess": 3}),
        ("prewarp", {"max_step": math.inf, "level": np.uint8(2), "depth_bits": 8}),
        ("splat", {"footprint": 2}),
        ("ldi", {"residuals": 0}),
    ],
)
def test_numbers_of_numpy_and_lists_are_taken(renderer, given):
    checked = checked_options(find_renderer(renderer), given)
    for name, value in given.items():
        np.testing.assert_array_equal(np.ravel(getattr(checked, name)), np.ravel(value))


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("ldi:threads=two", "renderer 'ldi': threads is 'two'; give a whole number from 0 to"),
        ("splat:footprint=big", "renderer 'splat': footprint is 'big'; give a number from 0 to 16"),
        ("relief:linear_steps=abc", "renderer 'relief': linear_steps is 'abc'; give a whole number from 1 to 4096"),
        ("prewarp:max_step=wide", "renderer 'prewarp': max_step is 'wide'; give a number above 0, or none"),
        ("prewarp:level=auto2", "level is 'auto2'; give auto, or a whole number from 0 to"),
        ("epipolar:search=best", "search is 'best'; choose among: exact, nearest, linear"),
        ("relief:light=1 2", "light is (1, 2); give a place x y z"),
        ("relief:model=shell,mapping=bump", "model 'shell' shows a relief, not mapping 'bump'"),
        ("ldi:thread=2", "no option 'thread'; its options are: residuals, samples, search, threads"),
    ],
)
def test_the_command_line_tells_them(tmp_path, text, told):
    words = ["render", "--asset", str(tmp_path), "--renderers", text, "--path", "orbit", "--out", str(tmp_path / "out")]
    result = CliRunner().invoke(cli, words, catch_exceptions=False)
    assert result.exit_code == 2
    assert told in " ".join(result.output.split())
    assert sum(line.startswith("Error: ") for line in result.output.splitlines()) == 1


def test_a_pipeline_file_tells_them(tmp_path):
    file = tmp_path / "wrong.yaml"
    file.write_text("stages: [ingest, asset, render]\nrender:\n  renderers: ['ldi:threads=two']\n")
    result = CliRunner().invoke(cli, ["run", str(file), "--capture", str(tmp_path), "--out", str(tmp_path / "out")])
    assert result.exit_code == 1
    assert "threads is 'two'; give a whole number from 0 to" in result.output
    assert "wrong.yaml:3" in result.output


def test_numbers_with_blanks_between_are_several():
    assert choose("relief:light=1 2 3.5,ambient=0.1").options == {"light": (1.0, 2.0, 3.5), "ambient": (0.1,)}


def test_render_tells_them_before_it_prepares():
    with pytest.raises(RendererError, match="renderer 'prewarp': level is 'top'"):
        ibrpipe.render([], ibrpipe.Camera.look_at((0, 0, 3), (0, 0, 0)), "prewarp", level="top")
