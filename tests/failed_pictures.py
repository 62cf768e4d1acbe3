"""A failing picture test writes what it got, what it wanted and the difference, where one can look at them.

Nothing needs to be called: when a test fails, the variables of the failed comparison are looked through, from the
innermost call outward, for two pictures of one shape: arrays under the names that comparisons use, or frames.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

#: names under which comparisons keep what they got and what they wanted; numpy's own come first
PAIRS = (("actual", "desired"), ("got", "wanted"), ("got", "want"), ("frame", "wanted"), ("compiled", "plain"))
#: least side of an array that is taken for a picture
SMALLEST = 4


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_makereport(item: pytest.Item, call: pytest.CallInfo[None]) -> Iterator[None]:
    """Write the pictures of a test that failed, and name their folder in its report."""
    outcome = yield
    report = outcome.get_result()  # type: ignore[attr-defined]
    if not report.failed or call.excinfo is None:
        return
    folder = item.config.rootpath / "failed-pictures" / re.sub(r"[^\w.=-]+", "-", item.nodeid)
    scopes = [entry.frame.f_locals for entry in reversed(call.excinfo.traceback)]
    written = write_pictures(scopes, folder)
    if written:
        report.sections.append(("pictures", "\n".join(str(path) for path in written)))


def write_pictures(scopes: list[Mapping[str, Any]], folder: Path) -> list[Path]:
    """Write the first comparison that is found in `scopes` into `folder`; return the files.

    Parameters
    ----------
    scopes : list of mappings
        Variables by name, of the failed call first.
    """
    for scope in scopes:
        for got, wanted in PAIRS:
            if got in scope and wanted in scope:
                parts = _parts(scope[got], scope[wanted])
                if parts:
                    return [path for name, one, other in parts for path in _write(folder, name, one, other)]
    return []


def _parts(got: Any, wanted: Any) -> list[tuple[str, np.ndarray, np.ndarray]]:
    """Return the pictures that two values hold both, by name."""
    if hasattr(got, "depth") and hasattr(wanted, "depth"):
        pairs = {name: (getattr(got, name, None), getattr(wanted, name, None)) for name in ("color", "depth", "alpha")}
    elif isinstance(got, Mapping) and isinstance(wanted, Mapping):
        pairs = {str(name): (got[name], wanted[name]) for name in got if name in wanted}
    else:
        pairs = {"": (got, wanted)}
    return [(name, np.asarray(one), np.asarray(other)) for name, (one, other) in pairs.items() if _alike(one, other)]


def _alike(one: Any, other: Any) -> bool:
    """Say whether two values are pictures of one shape."""
    if one is None or other is None:
        return False
    first, second = np.asarray(one), np.asarray(other)
    if first.shape != second.shape or first.dtype.kind not in "fiub" or second.dtype.kind not in "fiub":
        return False
    flat = first.ndim == 2 or (first.ndim == 3 and first.shape[2] == 3)
    return flat and min(first.shape[:2]) >= SMALLEST


def _write(folder: Path, name: str, got: np.ndarray, wanted: np.ndarray) -> list[Path]:
    import cv2

    folder.mkdir(parents=True, exist_ok=True)
    both = np.stack([got, wanted]).astype(np.float64)
    finite = both[np.isfinite(both)]
    low, high = (float(finite.min()), float(finite.max())) if finite.size else (0.0, 1.0)
    with np.errstate(invalid="ignore"):
        error = np.abs(both[0] - both[1])
    error[np.isnan(both).all(axis=0) | (both[0] == both[1])] = 0.0
    worst = float(error[np.isfinite(error)].max(initial=0.0))
    files = []
    for label, picture, bounds in (("got", both[0], (low, high)), ("wanted", both[1], (low, high)),
                                   ("difference", error, (0.0, worst))):  # fmt: skip
        path = folder / (f"{name}-{label}.png" if name else f"{label}.png")
        span = max(bounds[1] - bounds[0], 1e-30)
        codes = np.nan_to_num(255 * (picture - bounds[0]) / span, nan=0.0, posinf=255.0, neginf=0.0)
        pixels = np.clip(codes, 0, 255).astype(np.uint8)
        cv2.imwrite(str(path), pixels[..., ::-1] if pixels.ndim == 3 else pixels)
        files.append(path)
    return files
