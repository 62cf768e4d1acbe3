"""Which sources a result depends on, and what a block of code costs."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from ibrpipe.engine import provenance
from ibrpipe.engine.provenance import code_digest, count_child, measured, versions


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Return a small package: stage -> tools (import), kernels (late, by name), report (a package with a template)."""
    root = tmp_path / "tinypipe"
    (root / "report").mkdir(parents=True)
    (root / "__init__.py").write_text("")
    (root / "stage.py").write_text(
        "from tinypipe import tools\nfrom tinypipe.report import draw\nNAME = 'tinypipe.kernels:fast'\n"
    )
    (root / "tools.py").write_text("def run():\n    from tinypipe.deep import thing\n    return thing\n")
    (root / "deep.py").write_text("thing = 1\n")
    (root / "kernels.py").write_text("fast = 1\n")
    (root / "other.py").write_text("import tinypipe.stage\n")
    (root / "report/__init__.py").write_text("def draw(): ...\n")
    (root / "report/page.html").write_text("<p>")
    monkeypatch.syspath_prepend(str(tmp_path))
    yield root
    sys.modules.pop("tinypipe", None)
    forget()


def forget() -> None:
    for cached in (code_digest, provenance._sources, provenance._imports, provenance._file, provenance._top_file):
        cached.cache_clear()


def digest() -> str:
    forget()
    return code_digest("tinypipe.stage")


@pytest.mark.parametrize("name", ["stage.py", "tools.py", "deep.py", "kernels.py", "report/page.html", "__init__.py"])
def test_an_edit_in_what_the_stage_reaches_is_seen(package: Path, name: str) -> None:
    before = digest()
    assert digest() == before
    (package / name).write_text((package / name).read_text() + "\n")
    assert digest() != before


def test_an_edit_elsewhere_is_not(package: Path) -> None:
    before = digest()
    (package / "other.py").write_text("")
    (package / "new.py").write_text("")
    assert digest() == before
    assert "tinypipe" not in sys.modules


def test_every_stage_reaches_the_kernels_but_never_the_command_line() -> None:
    seen, waiting = set(), ["ibrpipe.stages.render"]
    while waiting:
        name = waiting.pop()
        if name not in seen:
            seen.add(name)
            waiting.extend(provenance._imports(name))
    assert {"ibrpipe.renderers.ldi", "ibrpipe.core.ldi.quadtree", "ibrpipe.io.assets", "ibrpipe.types"} <= seen
    assert not [name for name in seen if name.startswith("ibrpipe.cli")]


def test_versions_name_what_computes() -> None:
    assert {"python", "ibrpipe", "numpy", "numba", "scipy", "pycolmap"} <= set(versions())


def test_cost_of_a_block() -> None:
    with measured() as cost:
        block = np.ones(60_000_000 // 8)
        block += 1
        time.sleep(0.05)
    assert 0.05 <= cost.seconds < 5
    del block
    if sys.platform == "linux" and cost.peak_memory_bytes is not None:
        with measured() as later:
            pass
        assert later.peak_memory_bytes is not None
        assert 50e6 < cost.peak_memory_bytes - later.peak_memory_bytes < 200e6


def test_cost_of_a_block_counts_its_largest_child() -> None:
    with measured() as alone:
        count_child(None)
    with measured() as cost:
        for child in (1 << 40, 3 << 40, 2 << 40):
            count_child(child)
    count_child(5 << 40)  # no block is being measured
    if alone.peak_memory_bytes is not None:
        assert cost.peak_memory_bytes is not None
        assert (cost.peak_memory_bytes - alone.peak_memory_bytes) / (1 << 40) == pytest.approx(3.0, abs=1e-3)


def test_a_child_does_not_count_its_parents_memory() -> None:
    if sys.platform != "linux":
        pytest.skip("other systems have no count of their own for a child")
    block = np.ones(400_000_000 // 8)
    code = "from ibrpipe.engine.provenance import peak_memory; print(peak_memory())"
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert block[-1] == 1
    assert 5e6 < int(told.stdout) < 300e6
