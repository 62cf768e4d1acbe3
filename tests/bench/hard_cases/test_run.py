"""Every hard case with every renderer, within its limit; a cell beyond it fails here and in the command."""

from __future__ import annotations

import json

import numpy as np
import pytest
from click.testing import CliRunner

from ibrpipe.bench.cases import GROUPS, Case, Refusal, all_cases, choose_cases
from ibrpipe.bench.cases.spirals import build_spiral, expected, residual_of, spiral_camera
from ibrpipe.bench.hard_cases.file import read_hard_cases, write_hard_cases
from ibrpipe.bench.hard_cases.run import run_hard_cases
from ibrpipe.bench.oracles import fields
from ibrpipe.bench.oracles.surface import build_surface
from ibrpipe.bench.settings import EXACT, Limit, Setting, choose_settings
from ibrpipe.bench.speed_error.measure import measure
from ibrpipe.cli.main import cli
from ibrpipe.errors import ConfigError
from ibrpipe.types import Frame

LDI = ("ldi", "ldi patches", "ldi quadtree")


@pytest.fixture(scope="module")
def everything():
    """All settings with float32 depth; the first of each renderer with more (`make hard-cases` has every cell)."""
    settings = choose_settings()
    main = [each for each in settings if each.label in {each.renderer for each in settings}]
    found = run_hard_cases(all_cases(), settings, ("float64",), (32,)).model
    flat = [case for case in all_cases() if isinstance(case, Case)]
    more = run_hard_cases(flat, main, ("float32",)).model.cells
    more += run_hard_cases(choose_cases(["6"]), choose_settings(LDI), ("float64",), (16, 8)).model.cells
    return found.model_copy(update={"cells": [*found.cells, *more]})


def test_names_are_unique_and_every_group_has_cases():
    names = [case.name for case in all_cases()]
    assert len(set(names)) == len(names)
    assert {case.group for case in all_cases()} == set(GROUPS)


def test_every_cell_is_within_its_limit(everything):
    told = [f"{c.case} / {c.setting} / {c.input}, {c.bits} bits: {c.failures} {c.message}" for c in everything.failing]
    assert not told, "\n".join(told)
    assert len(everything.cells) > 4000


def test_what_does_not_apply_says_why(everything):
    assert all(cell.message for cell in everything.cells if cell.status == "not applicable")


def test_no_nan_and_the_same_bytes_everywhere(everything):
    rendered = [cell for cell in everything.cells if cell.figures]
    assert len(rendered) > 300
    assert all(cell.figures.nan == 0 for cell in rendered)
    assert all(cell.same_bytes for cell in rendered)


def test_most_cases_put_surfaces_before_the_camera(everything):
    """A case in which nothing is seen would pass whatever is rendered."""
    seen = {}
    for cell in everything.cells:
        if cell.figures:
            seen[cell.case] = max(seen.get(cell.case, 0), cell.figures.hits)
    empty = {name for name, hits in seen.items() if hits < 8}
    nothing = {"copies-empty-part", "copies-matrix-rank-1", "copies-matrix-rank-0"}
    nothing |= {
        "eye-looks-away",
        "surface-empty",
        "surface-one-texel-islands",
        "layers-empty",
        "mesh-instance-singular",
    }
    assert empty <= nothing


def test_fewer_bits_cost_what_half_a_step_says(everything):
    for name in LDI:
        cells = {
            cell.bits: cell
            for cell in everything.cells
            if (cell.case, cell.setting, cell.input) == ("bits-relief-tall", name, "float64")
        }
        step8, step16 = 20 / 255, 20 / 65535
        assert 0.2 * step8 < cells[8].figures.meant < 0.51 * step8
        assert 0.2 * step16 < cells[16].figures.meant < 0.6 * step16
        assert cells[32].figures.meant < 1e-4
        assert [cells[bits].depth_bytes for bits in (8, 16, 32)] == [180, 360, 720]


def test_spiral_oracle_meets_the_samples_themselves():
    """Along a sample's own direction the exact colour is that sample's; a circle of samples at the horizon too."""
    texture = build_spiral(1 / 8)
    for i in (0, 5, len(texture.residuals.alphas) // 2, len(texture.residuals.alphas) - 3):
        x, y, z = texture.residuals.directions[i]
        camera = spiral_camera(np.degrees(np.arctan2(y, x)), np.degrees(np.arccos(z)))
        middle = expected(texture, camera)[6, 7]
        np.testing.assert_allclose(middle - 0.4, residual_of(np.array([x, y, z])), atol=1e-6)


def broken(frame, how):
    depth, color = frame.depth.copy(), frame.color.copy()
    if how == "nan":
        depth[13, 16] = np.nan
    if how == "lost":
        depth[13, 16], color[13, 16] = np.inf, 0
    if how == "extra":
        depth[0, 0] = 3.0
    if how == "shifted":
        depth = depth * np.float32(1 + 2e-4)
    if how == "dark":
        color = color * np.float32(0.9)
    return Frame(color, depth, frame.alpha)


@pytest.mark.parametrize("how", ["nan", "lost", "extra", "shifted", "dark"])
def test_the_measure_sees_what_is_broken(how):
    import ibrpipe

    shot = next(case for case in all_cases() if case.name == "frame-rotated").build()
    surface = build_surface(shot.source)
    truth = fields.cast_truth([surface], shot.camera)
    hits = (truth.depth.ravel(), truth.patch.ravel(), truth.owner.ravel())
    color, _ = fields.colors_at([surface], shot.camera, fields.pixel_centers(shot.camera), hits)
    color = color.reshape(*truth.depth.shape, 3)
    good = ibrpipe.render(shot.source, shot.camera)
    assert np.isinf(truth.depth[0, 0])
    assert np.isfinite(truth.depth[13, 16])
    right, _ = measure([surface], truth, color, shot.camera, good)
    assert right.wrong == 0
    assert right.codes < EXACT.codes_p99
    found, _ = measure([surface], truth, color, shot.camera, broken(good, how))
    assert (found.nan == 1) == (how == "nan")
    assert (found.lost == 1) == (how == "lost")
    assert (found.extra == 1) == (how == "extra")
    assert (found.texels > 1e-3) == (how == "shifted")
    assert (found.codes_p99 > 1.0) == (how == "dark")


def test_what_is_accepted_wrongly_and_what_crashes_fails():
    cases = [
        Refusal("fine", 8, "nothing wrong", lambda dtype: None),
        Refusal("crash", 8, "another error", lambda dtype: 1 / 0),
    ]
    model = run_hard_cases(cases, []).model
    assert [cell.status for cell in model.cells] == ["fail"] * 4
    assert "ZeroDivisionError" in model.cells[-1].message


def test_limits_are_chosen_by_the_longest_name():
    loose, looser = Limit(1, 1, 1, 0, 0, 1, "a"), Limit(2, 2, 2, 0, 0, 2, "b")
    setting = Setting("ldi", "x", special={"grazing": loose, "grazing-89.9": looser})
    assert setting.limit_for("grazing-85") is loose
    assert setting.limit_for("grazing-89.9-low") is looser
    assert setting.limit_for("surface-spike") is EXACT


def test_choosing_by_name_group_and_mistake():
    assert {case.name for case in choose_cases(["grazing-8?"])} == {"grazing-80", "grazing-85", "grazing-89"}
    assert {case.group for case in choose_cases(["7"])} == {7}
    assert [setting.label for setting in choose_settings(["ldi quadtree"])] == ["ldi quadtree"]
    with pytest.raises(ConfigError, match="no hard case is called 'nothing'"):
        choose_cases(["nothing"])
    with pytest.raises(ConfigError, match="no renderer or setting 'nobody'"):
        choose_settings(["nobody"])


def test_command_writes_figures_and_page(tmp_path):
    result = CliRunner().invoke(cli, ["bench", "hard-cases", "--out", str(tmp_path / "x"), "--cases", "grazing-*"])
    assert result.exit_code == 0, result.output
    path = tmp_path / "x/hard_cases.json"
    stored, model = json.loads(path.read_text()), read_hard_cases(path)
    assert stored["schema_version"] == 4
    assert len(model.cases) == len(stored["cases"]) == 8
    assert len(model.cells) == len(stored["cells"]["case"])
    assert path.stat().st_size < 200 * len(model.cells) + 2000 * (len(model.settings) + 8)
    page = (tmp_path / "x/hard_cases.html").read_text()
    assert "grazing-89.9-low" in page
    assert "http" not in page.replace("http-equiv", "")
    assert "<script" not in page


def test_the_file_holds_what_was_found(tmp_path):
    """All that the cells hold comes back, figures to four digits."""
    chosen = choose_cases(["eye-looks-away", "grazing-89", "refused-nan", "surface-constant"])
    found = run_hard_cases(chosen, choose_settings(["ldi", "splat"]), depths=(8, 32)).model
    cells = [found.cells[0].model_copy(update={"status": "fail", "failures": ["one", "other"]}), *found.cells[1:]]
    model = found.model_copy(update={"cells": cells})
    write_hard_cases(tmp_path / "x.json", model)
    again = read_hard_cases(tmp_path / "x.json")
    assert (again.cases, again.settings, again.machine) == (model.cases, model.settings, model.machine)
    for one, other in zip(again.cells, model.cells, strict=True):
        left, right = one.model_dump(), other.model_dump()
        for part in ("figures", "limits"):
            for name, value in (right.pop(part) or {}).items():
                assert left[part][name] == (pytest.approx(value, rel=1e-3) if isinstance(value, float) else value)
            left.pop(part)
        assert left == right


def test_command_fails_where_a_cell_fails(tmp_path, monkeypatch):
    """A renderer that is right but for one pixel of one case makes the page red and the command fail."""
    from ibrpipe.bench.hard_cases import frames

    right = frames.render

    def render_wrong(*args, **options):
        frame = right(*args, **options)
        frame.depth[13, 16] += 0.1
        return frame

    monkeypatch.setattr(frames, "render", render_wrong)
    arguments = ["bench", "hard-cases", "--out", str(tmp_path), "--renderers", "ldi", "--cases", "frame-rotated"]
    result = CliRunner().invoke(cli, arguments)
    assert result.exit_code == 1
    assert "beyond their limits" in result.output
    assert 'class="c fail"' in (tmp_path / "hard_cases.html").read_text()


def test_command_names_what_there_is(tmp_path):
    result = CliRunner().invoke(cli, ["bench", "hard-cases", "--out", str(tmp_path), "--cases", "nothing"])
    assert result.exit_code == 1
    assert "no hard case" in result.output


def test_cases_build_what_they_say():
    for case in all_cases():
        if isinstance(case, Case):
            assert case.build().camera.width > 8
