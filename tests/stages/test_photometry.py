"""The photometry stage: what it undoes, what it leaves alone, and what it writes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ibrpipe.io.documents.photometry import Photometry
from ibrpipe.io.views import PHOTOMETRY, load_view, read_views, views_in_run, write_views
from ibrpipe.stages.photometry import STAGE, Inputs, PhotometryConfig, run


def balance(source: Path, out: Path, **settings: object) -> Photometry:
    """Run the stage on the views in a folder."""
    out.mkdir(parents=True)
    run(Inputs(source / "views.json", source / "mesh.ply", out), PhotometryConfig(samples=2000, **settings))
    return Photometry.read(out / "photometry.json", "no photometry", "photometry")


@pytest.fixture
def uneven(measured, tmp_path):
    """A matt capture whose photos, held-out ones too, were taken with other exposures and white balances."""
    folder = tmp_path / "uneven"
    folder.mkdir()
    source = measured("lambert").folder
    (folder / "mesh.ply").write_bytes((source / "mesh.ply").read_bytes())
    views, rng = read_views(source / "views.json"), np.random.default_rng(3)

    def changed(group):
        return tuple(replace(view, white_balance=tuple(rng.uniform(0.7, 1.4, 3).tolist())) for view in group)

    views = replace(views, train=changed(views.train), test=changed(views.test))
    write_views(views, folder / "views.json")
    return folder, views


def test_exposure_and_white_balance_are_undone(uneven, tmp_path):
    folder, before = uneven
    found = balance(folder, tmp_path / "photometry")
    assert found.applied
    after = read_views(tmp_path / "photometry" / "views.json")
    # stops: medians over photos of 96 x 72 pixels, whose pixels at the wall's edges hold other surface, too
    left = np.log2([view.white_balance for view in (*after.train, *after.test)])
    assert np.abs(left - np.median(left, axis=0)).max() < 0.05
    assert found.after < 0.5 * found.before
    assert (tmp_path / "photometry" / "summary.txt").read_text().startswith("exposure and white balance: photos dis")
    for told, view, was in zip(found.train, after.train, before.train, strict=True):
        assert told.name == view.name
        assert np.allclose(np.array(view.white_balance) / was.white_balance, told.factors, atol=1e-5)
        color, plain = load_view(view)[0], load_view(was)[0]
        assert np.allclose(color, plain * np.float32(told.factors), rtol=1e-4, atol=1e-6)
    assert [each.name for each in found.test] == [view.name for view in before.test]
    assert after.info[PHOTOMETRY] == found.why  # for the report


@pytest.mark.parametrize("scene", ["lambert", "glossy", "ball"])
def test_photos_that_agree_or_differ_by_gloss_are_left_alone(measured, tmp_path, scene):
    source = measured(scene).folder
    found = balance(source, tmp_path / scene)
    assert not found.applied
    assert "left alone" in found.why or "the surface differs" in found.why
    views = [read_views(folder / "views.json") for folder in (source, tmp_path / scene)]
    assert [view.factors.tolist() for view in views[0].train] == [view.factors.tolist() for view in views[1].train]
    assert PHOTOMETRY not in views[1].info
    assert found.test == []
    assert not (tmp_path / scene / "summary.txt").exists()


def test_settings_decide(uneven, measured, tmp_path):
    folder, _ = uneven
    assert not balance(folder, tmp_path / "never", balance="never").applied
    assert balance(measured("ball").folder, tmp_path / "always", balance="always").applied
    assert not balance(folder, tmp_path / "much", min_explained=1.0).applied
    assert not balance(folder, tmp_path / "far", min_stops=5.0).applied


def test_later_readers_take_these_views(measured, tmp_path):
    assert views_in_run(tmp_path) is None
    (tmp_path / "ingest").mkdir()
    (tmp_path / "ingest/views.json").write_bytes((measured("ball").folder / "views.json").read_bytes())
    assert views_in_run(tmp_path) == tmp_path / "ingest/views.json"
    balance(measured("ball").folder, tmp_path / STAGE.folder)
    assert views_in_run(tmp_path) == tmp_path / "photometry/views.json"
