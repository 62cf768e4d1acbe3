"""The page "A new renderer" is true: what it shows works, in Python and on the command line."""

from __future__ import annotations

import importlib.util
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import ibrpipe
from ibrpipe.errors import RendererError
from ibrpipe.io.assets import write_asset
from ibrpipe.modelling.relief_textures import asset_from_reliefs
from ibrpipe.renderers import registry

PAGE = (Path(__file__).parents[2] / "docs/new-renderer.md").read_text(encoding="utf-8")
FRAME = ibrpipe.ParallelFrame((0, 0, 0), (0.1, 0, 0), (0, 0.1, 0), (0, 0, 1))
CAMERA = ibrpipe.Camera.look_at((0.4, 0.3, 4), (0.4, 0.4, 0), (0, 1, 0), 20, 32, 24)


def block(language: str) -> str:
    """The first code block of a language on the page."""
    found = re.search(rf"```{language}\n(.*?)```", PAGE, re.DOTALL)
    assert found
    return found.group(1)


@pytest.fixture
def source():
    rng = np.random.default_rng(5)
    return ibrpipe.ReliefTexture(FRAME, rng.random((8, 9, 3)), 0.2 * rng.random((8, 9)))


@pytest.fixture
def points(tmp_path, monkeypatch):
    """The page's module, registered in this process as the page says."""
    file = tmp_path / "points.py"
    file.write_text(block("python"), encoding="utf-8")
    monkeypatch.setattr(registry, "_known", dict(registry._known))
    spec = importlib.util.spec_from_file_location("points", file)
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, "points", module)
    spec.loader.exec_module(module)
    registry.register("points", module.PointsRenderer)
    return module


def test_it_renders_where_the_exact_search_hits(points, source):
    frame, exact = ibrpipe.render(source, CAMERA, "points"), ibrpipe.render(source, CAMERA, "ldi")
    shown = np.isfinite(frame.depth)
    assert 20 < shown.sum() <= source.height.size
    assert np.isfinite(exact.depth[shown]).mean() > 0.6  # the texels of the border are outside the surface
    both = shown & np.isfinite(exact.depth)
    apart = np.abs(frame.depth[both] - exact.depth[both])  # a texel is shown up to half a pixel aside
    assert 1e-4 < np.median(apart) < 0.05
    assert apart.max() < 0.2
    bright = ibrpipe.render(source, CAMERA, "points", outputs=("color",), brightness=2)
    np.testing.assert_allclose(bright.color, 2 * frame.color, rtol=1e-6)
    assert bright.depth is None


def test_it_is_listed_and_checked_like_all_others(points, source):
    listed = ibrpipe.renderers()["points"]
    assert listed["accepts"] == ["ReliefTexture", "Texture", "Asset"]
    assert set(listed["options"]) == {"threads", "samples", "brightness"}
    told = re.search(r"`(renderer 'points': [^`]*)`", PAGE).group(1)
    with pytest.raises(RendererError, match=f"^{re.escape(told)}$"):
        ibrpipe.render(source, CAMERA, "points", brightness="much")
    with pytest.raises(RendererError, match="cannot take a DepthImage; it takes: ReliefTexture, Texture, Asset"):
        ibrpipe.prepare(ibrpipe.DepthImage(CAMERA, np.ones((24, 32, 3)), np.ones((24, 32))), "points")


def install(folder: Path, name: str, code: str, entry: str) -> None:
    """Put a package with one entry point into a folder of modules."""
    (folder / f"{name}.py").write_text(code, encoding="utf-8")
    info = folder / f"{name}-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(f"[{registry.GROUP}]\n{entry}\n")


def run(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(folder), *filter(None, sys.path)])}
    return subprocess.run([sys.executable, *words], env=environment, capture_output=True, text=True, timeout=300)


def test_the_command_line_knows_it_by_its_entry_point(tmp_path, source):
    entry = re.search(r'^points = "(.*)"$', block("toml"), re.MULTILINE).group(1)
    install(tmp_path, "points", block("python"), f"points = {entry}")
    write_asset(asset_from_reliefs([source], ["front"], "test"), tmp_path / "brick")
    words = [
        "-m",
        "ibrpipe",
        "render",
        "--asset",
        str(tmp_path / "brick"),
        "--renderers",
        "points:brightness=2",
        "--path",
        "orbit:frames=1,width=32,height=24,up=y",
        "--repeats",
        "1",
        "--out",
        str(tmp_path / "o"),
    ]
    done = run(tmp_path, *words)
    assert done.returncode == 0, done.stderr
    document = json.loads((tmp_path / "o/render-orbit-frames=1,width=32,height=24,up=y/frames.json").read_text())
    assert [frame["renderer"] for frame in document["frames"]] == ["points:brightness=2"]


def test_a_broken_package_is_told_in_one_line_and_breaks_nothing(tmp_path):
    install(tmp_path, "points", block("python"), "points = points:PointsRenderer")
    install(tmp_path, "broken", "import nothing_of_that_name\n", "broken = broken:Broken")
    install(tmp_path, "strange", "class Strange: pass\n", "strange = strange:Strange")
    install(tmp_path, "second", block("python").replace("points", "ldi"), "ldi = second:PointsRenderer")
    done = run(tmp_path, "-W", "error", "-c", "import ibrpipe; ibrpipe.renderers(); print(*ibrpipe.renderers())")
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == [*registry.BUILT_IN, "points"]
    lines = sorted(done.stderr.splitlines())
    assert len(lines) == 3, done.stderr
    assert lines[0].startswith("renderer 'broken' of package broken 1.0 cannot be loaded (ModuleNotFoundError: ")
    assert lines[1] == "renderer 'ldi' of package second 1.0 is left out: there is another one of that name"
    assert lines[2].startswith("renderer 'strange' of package strange 1.0 cannot be loaded (RendererError: ")
    call = "from ibrpipe.renderers.registry import find_renderer; find_renderer('broken')"
    assert "mend or remove that package" in run(tmp_path, "-c", call).stderr


def test_listing_renderers_imports_no_kernels():
    code = "import sys, ibrpipe; ibrpipe.renderers(); sys.exit('numba' in sys.modules)"
    assert run(Path(), "-c", code).returncode == 0


class Half(registry.Renderer):
    name = "half"


@pytest.mark.parametrize(
    ("name", "found", "told"),
    [
        ("half", Half, "lacks summary, paper, limits, accepts, Options, draw, prepare"),
        ("half", dict, "no subclass of ibrpipe.renderers.renderer.Renderer"),
        ("Half", "a:B", "no name of a renderer"),
        ("ldi", "elsewhere:Ldi", "there is a renderer 'ldi' already"),
    ],
)
def test_what_is_no_renderer_is_refused(name, found, told):
    with pytest.raises(RendererError, match=told):
        registry.register(name, found)


def test_a_renderer_goes_by_one_name(points):
    with pytest.raises(RendererError, match="'dots' calls itself 'points'"):
        registry.register("dots", points.PointsRenderer)


def test_a_module_that_is_missing_is_told(monkeypatch):
    monkeypatch.setattr(registry, "_known", dict(registry._known))
    registry.register("absent", "nothing_of_that_name:Absent")
    with pytest.raises(RendererError, match="'absent' cannot be loaded from nothing_of_that_name:Absent"):
        registry.find_renderer("absent")
