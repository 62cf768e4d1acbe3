"""Masks by brightness: the object without specks, small holes closed, large ones kept; through views and ingest."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np

from ibrpipe.io.captures import read_capture
from ibrpipe.io.photos.threshold_masks import threshold_mask
from ibrpipe.io.views import View, ViewSet, load_view, read_views, write_views
from ibrpipe.stages import ingest


def test_specks_go_and_large_holes_stay() -> None:
    picture = np.full((60, 80, 3), 0.001, np.float32)
    picture[10:50, 10:60] = 0.5
    picture[20:22, 20:22] = 0.0  # a small hole: dirt
    picture[30:45, 30:45] = 0.0  # a large one: the background
    picture[5:8, 70:73] = 0.9  # a speck
    mask = threshold_mask(picture, 0.2)
    assert mask.dtype == np.float32
    assert mask[21, 21] == 1
    assert mask[35, 35] == 0
    assert mask[6, 71] == 0
    assert mask.sum() == 40 * 50 - 15 * 15
    assert threshold_mask(picture, 0.99).sum() == 0
    assert threshold_mask(picture + 1, 0.2).all()


def test_views_carry_the_threshold(tiny_ball: Path, tmp_path: Path) -> None:
    view = read_capture(tiny_ball).train[0]
    bare = replace(view, mask=None, mask_from_alpha=False)
    assert not bare.masked
    write_views(ViewSet((replace(bare, mask_threshold=0.3),)), tmp_path / "views.json")
    again: View = read_views(tmp_path / "views.json").train[0]
    assert again.masked
    assert again.mask_threshold == 0.3
    mask = load_view(again)[1]
    assert 0 < mask.mean() < 1
    document = json.loads((tmp_path / "views.json").read_text())
    del document["train"][0]["mask_threshold"]  # as written before it was known
    (tmp_path / "views.json").write_text(json.dumps(document))
    assert read_views(tmp_path / "views.json").train[0].mask_threshold is None


def test_ingest_masks_by_brightness_and_takes_every_other_photo(tiny_ball: Path, tmp_path: Path) -> None:
    capture = tmp_path / "capture"
    shutil.copytree(tiny_ball, capture)
    shutil.rmtree(capture / "masks")
    (capture / "transforms.json").unlink()
    before = ingest.run(ingest.Inputs(capture, tmp_path / "a"), ingest.IngestConfig())
    done = ingest.run(ingest.Inputs(capture, tmp_path / "b"), ingest.IngestConfig(mask_threshold=0.2, use_every=2))
    all_of_them, views = read_views(before.views), read_views(done.views)
    assert [view.name for view in views.train] == [view.name for view in all_of_them.train[::2]]
    assert len(views.test) == len(all_of_them.test)
    assert all(view.mask_threshold == 0.2 for view in views.train)
    assert all(view.mask is not None for view in views.test)  # their own masks count
