"""The page of the hard cases."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from ibrpipe.bench.cases import GROUPS
from ibrpipe.bench.hard_cases.frames import WrongPixels
from ibrpipe.bench.hard_cases.results import Cell, Figures, HardCasesModel, Limits
from ibrpipe.bench.hard_cases.run import HardRun
from ibrpipe.bench.report.template import figure, fill, picture, share
from ibrpipe.bench.settings import EXACT
from ibrpipe.types import Array

#: wrong pictures shown for each setting
SHOWN = 3
#: error of coverage up to which scenes of copies show nothing but rounding
COVERED = 1e-3
#: kinds of case that have tables of their own, by what their names hold, and how these are called
KINDS = {"": "", "mesh-": ": relief-mapped meshes", "copies-": ": scenes of copies"}


def write_hard_page(path: Path, run: HardRun) -> None:
    """Write the page: one file without scripts that loads nothing from anywhere."""
    model = run.model
    groups = _groups(model)
    path.write_text(
        fill(
            "hard_cases.html",
            model=model,
            renderers={setting.renderer for setting in model.settings},
            failing=model.failing,
            measured=sum(cell.status != "not applicable" for cell in model.cells),
            pixels=next((cell.figures.pixels for cell in model.cells if cell.figures), 0),
            glance=_glance(model, groups),
            groups=groups,
            pictures=_pictures(run),
            bit_rows=_bit_rows(model),
            limit_rows=_limit_rows(model),
            reasons=_reasons(model),
        ),
        encoding="utf-8",
    )


def _glance(model: HardCasesModel, groups: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """One row for each group: what every setting shows over all its cells; a table for each of `KINDS`."""
    named = {row["name"]: group["title"] for group in groups for row in group["rows"]}
    cells: dict[tuple[str, str], list[Cell]] = {}
    for cell in model.cells:
        if cell.status != "not applicable" and cell.setting != "load":
            cells.setdefault((named[cell.case], cell.setting), []).append(cell)
    tables = []
    for kind in KINDS:
        titles = [group["title"] for group in groups if group["kind"] == kind]
        columns = [s.label for s in model.settings if any((title, s.label) in cells for title in titles)]
        rows = [
            {"title": title, "cells": [_summed(cells.get((title, n), [])) for n in columns]}
            for title in titles
            if any((title, n) in cells for n in columns)
        ]
        if rows:
            tables.append({"columns": columns, "rows": rows})
    return tables


def _summed(cells: Sequence[Cell]) -> dict[str, str]:
    """Return what many cells show together: how many fail, else the share of wrong pixels, in all and in the worst."""
    shown = [cell for cell in cells if cell.figures]
    failing = sum(cell.status == "fail" for cell in cells)
    shares = [_wrong(c.figures) / c.figures.pixels for c in shown if c.figures]
    if not cells:
        return {"tone": "none", "text": "–", "more": ""}
    if failing:
        return {"tone": "fail", "text": f"{failing} of {len(cells)} fail", "more": ""}
    if not any(shares):
        tone = "pass" if all(map(_exact, shown)) else "within"
        return {"tone": tone, "text": "0", "more": ""}
    return {"tone": "within", "text": share(sum(shares) / len(shares)), "more": f"≤ {share(max(shares))}"}


def _wrong(found: Figures) -> int:
    return found.lost + found.extra + found.astray


def _exact(cell: Cell) -> bool:
    """Say whether a cell shows nothing but rounding."""
    assert cell.figures
    if cell.figures.coverage is not None:
        return (
            not _wrong(cell.figures) and abs(cell.figures.coverage) <= COVERED and (cell.figures.leak or 0.0) <= COVERED
        )
    most = (cell.limits.texels or 0.0) if cell.limits else 0.0
    return not _wrong(cell.figures) and (cell.figures.texels or 0.0) <= max(EXACT.texels, most)


def _groups(model: HardCasesModel) -> list[dict[str, Any]]:
    """A table for each group and each of `KINDS`, with the columns that have anything to show."""
    cells: dict[tuple[str, str], list[Cell]] = {}
    for cell in model.cells:
        cells.setdefault((cell.case, cell.setting), []).append(cell)
    labels = [setting.label for setting in model.settings]
    found = []
    for number, name in GROUPS.items():
        for kind, told in KINDS.items():
            facts = [case for case in model.cases if case.group == number and _kind(case.name) == kind]
            columns = [
                n
                for n in (*labels, "load")
                if any(c.status != "not applicable" for case in facts for c in cells.get((case.name, n), []))
            ]
            rows: list[dict[str, Any]] = [
                {
                    "name": case.name,
                    "what": case.what,
                    "cells": [_worst(cells.get((case.name, n), [])) for n in columns],
                    "parts": _parts([cells.get((case.name, n), []) for n in columns]),
                }
                for case in facts
            ]
            failing = any(cell["tone"] == "fail" for row in rows for cell in row["cells"])
            title = f"{number} · {name}{told}"
            if rows:
                found.append({"title": title, "columns": columns, "rows": rows, "open": failing, "kind": kind})
    return found


def _kind(case: str) -> str:
    """Return which of `KINDS` a case is by its name."""
    return next((kind for kind in KINDS if kind and kind in case), "")


def _worst(cells: Sequence[Cell]) -> dict[str, str]:
    """Return what is shown for all types of input and all bits together: the worst of the cells."""
    if not cells:
        return _shown(None)
    order = ("not applicable", "refused", "pass", "fail")

    def badness(cell: Cell) -> tuple[int, float, float]:
        found = cell.figures
        if found is None:
            return order.index(cell.status), 0.0, 0.0
        return order.index(cell.status), _wrong(found), abs(found.coverage or 0.0) or found.texels or found.codes or 0.0

    chosen, held = max(cells, key=badness), sum(cell.status in ("pass", "refused") for cell in cells)
    shown, tried = _shown(chosen), sum(cell.status != "not applicable" for cell in cells)
    if tried:
        shown["title"] = f"{held} of {tried} within; the worst, {chosen.input}, {chosen.bits} bits: {shown['title']}"
    return shown


def _parts(columns: Sequence[Sequence[Cell]]) -> list[dict[str, Any]]:
    """One row for each type of input and number of bits."""
    spots = dict.fromkeys((cell.input, cell.bits) for cells in columns for cell in cells)
    found = []
    for spot in spots:
        mine = [next((cell for cell in cells if (cell.input, cell.bits) == spot), None) for cells in columns]
        found.append({"input": spot[0], "bits": spot[1], "cells": [_shown(cell) for cell in mine]})
    return found


def _reasons(model: HardCasesModel) -> list[dict[str, Any]]:
    """Why combinations do not apply, and how many."""
    counts: dict[str, list[Cell]] = {}
    for cell in model.cells:
        if cell.status == "not applicable":
            counts.setdefault(cell.message, []).append(cell)
    return [
        {
            "reason": reason,
            "cells": len(cells),
            "cases": _told({cell.case for cell in cells}),
            "settings": ", ".join(dict.fromkeys(cell.setting for cell in cells)),
        }
        for reason, cells in counts.items()
    ]


def _shown(cell: Cell | None) -> dict[str, str]:
    """Return tone, text and tooltip of one cell of the table."""
    if cell is None or cell.status == "not applicable":
        return {"tone": "none", "text": "–", "more": "", "title": cell.message if cell else ""}
    if cell.figures is None:
        text = {"pass": "refused", "refused": "refused", "fail": "failed"}[cell.status]
        return {"tone": cell.status, "text": text, "more": "", "title": cell.message or "; ".join(cell.failures)}
    found = cell.figures
    wrong = _wrong(found)
    text = figure(found.texels)
    if found.texels is None and found.codes is not None:
        text = f"{figure(found.codes)} codes"
    if found.coverage is not None:
        text = f"{100.0 * found.coverage:+.1f} % area"
    tone = cell.status if cell.status != "pass" or _exact(cell) else "within"
    title = (
        f"{wrong} wrong ({found.lost} lost, {found.extra} extra, {found.astray} astray), {found.doubtful} doubtful; "
        f"99 %: {figure(found.texels_p99)} texels, {figure(found.shift_p99)} pixels, {figure(found.codes_p99)} codes"
    )
    if found.leak is not None:
        title += f"; {100.0 * found.leak:.2g} % seen through covered pixels"
    more = f"{wrong} w" if wrong else ""
    return {"tone": tone, "text": text, "more": more, "title": "; ".join([*cell.failures, title])}


def _pictures(run: HardRun) -> list[dict[str, str]]:
    found = []
    order = {(c.case, c.setting): c for c in run.model.cells if (c.input, c.bits) == ("float64", 32)}
    for setting in run.model.settings:
        mine = [(case, maps) for (case, label), maps in run.pictures.items() if label == setting.label]
        mine.sort(key=lambda item: (order[item[0], setting.label].status != "fail", -int(item[1].wrong.sum())))
        for case, maps in mine[:SHOWN]:
            cell = order[case, setting.label]
            limits = cell.limits.reason if cell.limits else ""
            note = f"{share(int(maps.wrong.sum()), maps.wrong.size)} of the pixels wrong; {limits}"
            found.append({"setting": setting.label, "case": case, "note": note, **_drawn(maps)})
    return found


def _drawn(maps: WrongPixels) -> dict[str, str]:
    return {name: picture(values, 240) for name, values in draw_wrong(maps).items()}


def draw_wrong(maps: WrongPixels) -> dict[str, Array]:
    """Return pictures (H, W, 3) uint8 of the exact depth, of the rendered one, and of where they differ."""
    some = maps.exact[np.isfinite(maps.exact)]
    if not len(some):
        some = maps.rendered[np.isfinite(maps.rendered)]
    low, high = (float(some.min()), float(some.max())) if len(some) else (0.0, 1.0)
    exact, rendered = (_shade(depth, low, high) for depth in (maps.exact, maps.rendered))
    wrong = np.where(maps.wrong[..., None], np.array([179, 38, 30], np.uint8), 200 + exact // 5)
    return {"exact": exact, "rendered": rendered, "wrong": wrong}


def _shade(depth: Array, low: float, high: float) -> Array:
    """Grey picture (H, W, 3) uint8 of a depth map: near is bright, nothing is white."""
    with np.errstate(invalid="ignore"):
        level = 215.0 - 175.0 * np.clip((depth - low) / max(high - low, 1e-300), 0, 1)
    level = np.where(np.isfinite(depth), level, 250.0)
    return np.repeat(np.nan_to_num(level, nan=250.0).astype(np.uint8)[..., None], 3, axis=2)


def _bit_rows(model: HardCasesModel) -> list[dict[str, Any]]:
    """One row for each setting: distance from the surface before it was stored, over cases with all three bits."""
    shared = {cell.case for cell in model.cells if cell.bits == 8}
    rows = []
    for setting in model.settings:
        mine = [c for c in model.cells if c.setting == setting.label and c.case in shared and c.figures]
        parts = []
        for bits in (8, 16, 32):
            values = [c.figures.meant for c in mine if c.bits == bits and c.figures and c.figures.meant is not None]
            parts.append(
                {"median": median(values) if values else None, "largest": max(values, default=None), "bytes": bits // 8}
            )
        if mine:
            rows.append({"name": setting.label, "cells": parts})
    return rows


def _limit_rows(model: HardCasesModel) -> list[dict[str, Any]]:
    """One row for each setting and reason; where the limits differ by rounding, the widest."""
    rows: dict[tuple[str, str], list[tuple[str, Limits]]] = {}
    for cell in model.cells:
        if cell.limits:
            rows.setdefault((cell.setting, cell.limits.reason), []).append((cell.case, cell.limits))
    return [
        {
            "setting": setting,
            "cases": _told({case for case, _ in found}),
            "most": [_widest([getattr(limits, name) for _, limits in found]) for name in names],
            "reason": reason,
        }
        for (setting, reason), found in rows.items()
        for names in [("texels", "texels_p99", "shift_p99", "wrong", "gross", "codes_p99", "coverage", "leak")]
    ]


def _told(cases: set[str]) -> str:
    return ", ".join(sorted(cases)) if len(cases) <= 4 else f"{len(cases)} cases"


def _widest(values: Sequence[float | None]) -> str:
    if any(value is None for value in values):
        return "none"
    low, high = min(v for v in values if v is not None), max(v for v in values if v is not None)
    return figure(high) if figure(low) == figure(high) else f"{figure(low)} to {figure(high)}"
