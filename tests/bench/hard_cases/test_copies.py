"""What the cells of scenes of copies see: too much or too little area, leaks, another colour, NaN."""

from __future__ import annotations

import numpy as np
import pytest

from ibrpipe.bench.cases import choose_cases
from ibrpipe.bench.hard_cases import copies, frames
from ibrpipe.bench.hard_cases.run import run_hard_cases
from ibrpipe.bench.settings import choose_settings
from ibrpipe.types import Frame


def broken(frame, how):
    color, depth, alpha = frame.color.copy(), frame.depth.copy(), frame.alpha.copy()
    if how == "wider":
        alpha = np.minimum(1.1 * alpha + 0.002, 1)
    if how == "leaks":
        alpha = np.where(alpha == 1, 0.97, alpha)
    if how == "lost":
        alpha[18, 24] = 0.4
    if how == "extra":
        alpha[1, 1] = 0.6
    if how == "dark":
        color *= 0.7
    if how == "far":
        depth *= 1.2
    if how == "nan":
        color[18, 24, 1] = np.nan
    return Frame(color, depth, alpha)


TOLD = {
    "right": "", "wider": "covered area", "leaks": "seen through", "lost": "1 lost", "extra": "1 extra",
    "dark": "codes of colour", "far": "texels of depth", "nan": "hold NaN",
}  # fmt: skip


@pytest.mark.parametrize("how", TOLD)
def test_what_is_broken_is_told(how, monkeypatch):
    right = frames.render
    monkeypatch.setattr(frames, "render", lambda *given, **options: broken(right(*given, **options), how))
    settings = choose_settings(["hierarchical polygons"])
    (cell,) = run_hard_cases(choose_cases(["copies-opaque-sphere"]), settings, ("float64",)).model.cells
    assert cell.status == ("fail" if TOLD[how] else "pass")
    assert TOLD[how] in "; ".join(cell.failures)


def test_settings_of_scenes_take_part_in_scenes_alone():
    settings = choose_settings(["hierarchical", "ldi"])
    cells = run_hard_cases(choose_cases(["grazing-89", "copies-empty-part"]), settings, ("float64",), (32,)).model.cells
    assert {(cell.case.split("-")[0], cell.setting.split()[0]) for cell in cells} == {
        ("grazing", "ldi"),
        ("copies", "hierarchical"),
    }
    assert copies.copies_cells(choose_cases(["copies-empty-part"])[0], [], {}, ("float64",)) == []
