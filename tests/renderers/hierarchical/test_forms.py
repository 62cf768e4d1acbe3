"""Both forms of parts: what they lose is measured, and units of an executor change no byte."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numba
import numpy as np
import pytest

from ibrpipe.renderers.hierarchical import forms
from ibrpipe.renderers.hierarchical.data import HierarchicalData
from ibrpipe.renderers.hierarchical.forms import measure_forms, prerender
from ibrpipe.renderers.hierarchical.guide import build_guide
from ibrpipe.renderers.hierarchical.nodes import scene_nodes
from ibrpipe.renderers.hierarchical.prefiltering import Slicing
from ibrpipe.synthetic.instanced.forest import forest
from ibrpipe.synthetic.instanced.solids import solids

pytestmark = pytest.mark.skipif(numba.config.DISABLE_JIT, reason="minutes as plain Python")

COARSE = Slicing(directions=24, rays=2, finest=16)


@pytest.fixture(scope="module")
def made():
    return prerender(solids(), COARSE)


def measured(scene, library):
    nodes = scene_nodes(scene)
    return measure_forms(HierarchicalData(nodes, library, build_guide(nodes, library), forms._LIGHT))


def test_solids_lose_little_in_slices_and_more_in_views_without_coverage(made):
    errors = made.library.info["errors"]
    assert set(errors) == set(made.library.names)
    for slices, views in errors.values():
        assert slices.psnr > 15
        assert slices.coverage < 0.25
        assert views.psnr > 10
        assert views.coverage < 0.4


def test_damage_is_measured(made):
    library = made.library
    dark = library.texels.copy()
    dark[:, 1:4] //= 2
    darker = measured(made.scene, replace(library, texels=dark))
    views = replace(library.views, albedo=0.1 * library.views.albedo)
    worse = measured(made.scene, replace(library, views=views))
    for name, (slices, published) in library.info["errors"].items():
        assert darker[name][0].psnr < slices.psnr - 1
        assert darker[name][0].coverage == pytest.approx(slices.coverage)
        assert darker[name][1] == published
        assert worse[name][0] == slices
        assert worse[name][1].psnr < published.psnr


def test_large_parts_are_measured_without_views_and_larger_ones_not(monkeypatch):
    from ibrpipe.renderers.hierarchical import prefiltering

    monkeypatch.setattr(prefiltering, "MOST_POLYGONS", 20_000)
    library = prerender(forest(3), Slicing(7, 6.0, 2, 8)).library
    whole = [name for name in library.names if name.endswith("-tree")]
    assert whole
    for name in whole:
        slices, views = library.info["errors"][name]
        assert slices.psnr > 10
        assert views == forms.FormError(None, None)
    monkeypatch.setattr(forms, "MOST_TRIANGLES", 20_000)
    assert not set(whole) & set(measured(forest(3), library))


def test_units_of_an_executor_change_no_byte(made):
    with ThreadPoolExecutor(2) as pool:
        other = prerender(solids(), COARSE, pool).library
    for name in ("stacks", "slabs", "heights", "means", "texels"):
        np.testing.assert_array_equal(getattr(other, name), getattr(made.library, name))
    assert other.info["errors"] == made.library.info["errors"]
