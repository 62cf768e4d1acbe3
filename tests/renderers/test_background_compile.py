"""A second process compiles part of what the first call of a renderer needs."""

from __future__ import annotations

import os
import subprocess
import sys
from importlib import import_module

import numba
import numpy as np
import page_assets
import pytest
from numba.core.sigutils import normalize_signature

import ibrpipe
import ibrpipe.types
from ibrpipe.renderers import background_compile
from ibrpipe.renderers.background_compile import BackgroundCompile, Kernel
from ibrpipe.renderers.prewarp import passes
from ibrpipe.renderers.relief import height_fields, meshes
from ibrpipe.renderers.search import epipolar_lines, projection
from ibrpipe.renderers.view_dependence import reflection, spiral

SMALL = Kernel("relief.shade", "place_hits", "(float32[:,::1], uint32[:,::1], uint32, float64[::1], float64[:,::1], "
               "float64[:,:,::1])")  # fmt: skip
#: renderer -> what is compiled for it; `meanwhile` of the maps serves `relief`, too
LISTED = {"prewarp": passes.BACKGROUND, "relief": height_fields.BACKGROUND, "ldi": epipolar_lines.BACKGROUND}


@pytest.mark.skipif(numba.config.DISABLE_JIT, reason="nothing is compiled")
@pytest.mark.parametrize("renderer", LISTED)
def test_what_is_listed_is_what_a_frame_calls(renderer):
    """A kernel whose arguments change would be compiled in vain, and once more by the first process."""
    frame = ibrpipe.ParallelFrame((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1))
    source = ibrpipe.ReliefTexture(frame, np.ones((9, 9, 3)), np.random.default_rng(1).random((9, 9)))
    camera = ibrpipe.Camera.look_at((4.5, -3.0, 12.0), (4.5, 4.5, 0.5), width=24, height=20)
    ibrpipe.render(source, camera, renderer, outputs=("color", "depth"))
    for kernel in (*LISTED[renderer].kernels, *LISTED[renderer].meanwhile):
        if renderer == "ldi" and kernel.module == "relief.shade":
            continue
        called = getattr(import_module(f"ibrpipe.core.{kernel.module}"), kernel.name).signatures
        assert normalize_signature(kernel.types)[0] in called, kernel.name


@pytest.mark.skipif(numba.config.DISABLE_JIT, reason="nothing is compiled")
def test_what_is_listed_for_meshes_is_what_a_frame_calls():
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0]], float)
    mesh = ibrpipe.types.Mesh(corners, np.array([[0, 1, 2]]))
    source = ibrpipe.ReliefMesh(mesh, corners[None, :, :2], np.ones((3, 3)), 0.1)
    ibrpipe.render(source, ibrpipe.Camera.look_at((0, 0.1, 3), (0, 0, 0), width=16, height=12), "relief")
    for kernel in (*meshes.BACKGROUND.kernels, *meshes.BACKGROUND.meanwhile):
        called = getattr(import_module(f"ibrpipe.core.{kernel.module}"), kernel.name).signatures
        assert normalize_signature(kernel.types)[0] in called, kernel.name


@pytest.mark.skipif(numba.config.DISABLE_JIT, reason="nothing is compiled")
def test_colours_of_lines_in_relief_are_listed(monkeypatch):
    monkeypatch.setattr(height_fields, "LINES", 0)
    test_what_is_listed_is_what_a_frame_calls("relief")
    for kernel in epipolar_lines.BACKGROUND.meanwhile[1:]:
        called = getattr(import_module(f"ibrpipe.core.{kernel.module}"), kernel.name).signatures
        assert normalize_signature(kernel.types)[0] in called, kernel.name


@pytest.mark.skipif(numba.config.DISABLE_JIT, reason="nothing is compiled")
@pytest.mark.parametrize(
    ("kind", "listed"),
    [("matt", projection.BACKGROUND), ("mirror", reflection.BACKGROUND), ("spiral", spiral.BACKGROUND)],
)
def test_what_is_listed_for_layers_is_what_a_frame_calls(kind, listed):
    asset = page_assets.make_asset(kind)
    ibrpipe.render(asset, ibrpipe.orbit(asset, 1, width=24, height=20)[0])
    for kernel in (*listed.kernels, *listed.meanwhile):
        called = getattr(import_module(f"ibrpipe.core.{kernel.module}"), kernel.name).signatures
        assert normalize_signature(kernel.types)[0] in called, kernel.name


@pytest.mark.skipif(numba.config.DISABLE_JIT, reason="nothing is compiled")
@pytest.mark.parametrize(
    ("module", "name"),
    [("reflection.voxels", "meet_listed"), ("ldi.patches", "best_partner"), ("ldi.patches", "walk_on")],
)
def test_shared_functions_are_compiled_once(module, name):
    """Each literal that such a function is given compiles it anew."""
    camera = ibrpipe.Camera.look_at((0, 0.1, 3), (0, 0, 0), width=16, height=12)
    ibrpipe.render(page_assets.make_asset("mirror"), camera)
    signatures = getattr(import_module(f"ibrpipe.core.{module}"), name).signatures
    assert not [each for each in signatures if any(isinstance(part, numba.types.Literal) for part in each)]


SCRIPT = """
import sys
sys.path[:0] = sys.argv[1:]
from ibrpipe.core.relief import shade as relief_shade
from ibrpipe.renderers.background_compile import BackgroundCompile, is_cached
from test_background_compile import SMALL
beside = BackgroundCompile((SMALL,))
assert not is_cached(SMALL)
beside.begin()
assert beside._process is not None
beside.wait()
assert is_cached(SMALL)
from numba.core.sigutils import normalize_signature
relief_shade.place_hits.compile(normalize_signature(SMALL.types)[0])
assert sum(relief_shade.place_hits.stats.cache_hits.values()) == 1
again = BackgroundCompile((SMALL,))
again.begin()
assert again._process is None
"""


@pytest.mark.skipif(numba.config.DISABLE_JIT or numba.config.NUMBA_NUM_THREADS < 2, reason="one process compiles all")
def test_second_process_fills_the_cache_that_the_first_loads(tmp_path):
    environment = {**os.environ, "IBRPIPE_CACHE_DIR": str(tmp_path)}
    here = os.path.dirname(os.path.abspath(__file__))
    subprocess.run([sys.executable, "-c", SCRIPT, here, os.path.dirname(here)], check=True, env=environment)


def test_without_a_second_process_nothing_is_waited_for(monkeypatch):
    monkeypatch.setattr(background_compile, "is_cached", lambda _: False)

    def fail(*_, **__):
        raise OSError("not permitted")

    monkeypatch.setattr(background_compile.subprocess, "Popen", fail)
    beside = BackgroundCompile((SMALL,))
    beside.begin()
    beside.wait()
    assert beside._process is None


def test_a_second_process_that_takes_too_long_is_ended_and_leaves_nothing(monkeypatch):
    monkeypatch.setattr(background_compile, "is_cached", lambda _: False)
    monkeypatch.setattr(background_compile, "PROGRAM", "import time; time.sleep(60)")
    monkeypatch.setattr(background_compile, "PATIENCE", 0.0)
    monkeypatch.setattr(background_compile.numba.config, "DISABLE_JIT", 0)
    monkeypatch.setattr(background_compile.numba.config, "NUMBA_NUM_THREADS", 2)
    beside = BackgroundCompile((SMALL,))
    beside.begin()
    process = beside._process
    assert process is not None
    beside.wait()
    assert process.returncode is not None  # reaped
    assert beside._process is None
