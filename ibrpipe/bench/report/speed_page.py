"""The page of speed against error."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ibrpipe.bench.report.error_pictures import draw_errors, gradient
from ibrpipe.bench.report.plots import growth_plot, pareto_plot, region_plot, styles
from ibrpipe.bench.report.template import figure, fill, share
from ibrpipe.bench.speed_error.advice import NEEDS, Advice, advise
from ibrpipe.bench.speed_error.results import Score, SpeedErrorModel, WorkFacts
from ibrpipe.bench.speed_error.run import SpeedRun
from ibrpipe.bench.speed_error.workloads import FIRST


def write_speed_page(path: Path, run: SpeedRun) -> None:
    """Write the page: one file without scripts that loads nothing from anywhere."""
    model = run.model
    path.write_text(
        fill(
            "speed_error.html",
            model=model,
            needs=NEEDS,
            recommended=recommended(model),
            prices=_prices(model),
            layers=_layers(model),
            advice=_advice(model),
            paretos=_paretos(model),
            growth=_growth(model),
            regions=_regions(model),
            pictures=_pictures(run),
            gradient=gradient(),
            totals=_totals(model),
            labels={c.label: c for c in model.contenders},
            colors={label: color for label, (color, _) in styles(model.contenders).items()},
        ),
        encoding="utf-8",
    )


def recommended(model: SpeedErrorModel) -> list[dict[str, Any]]:
    """One row for each thing: whom to use under each demand, its time over all views, its error, and the next."""
    rows = []
    for work in model.works:
        cells = []
        for need in NEEDS:
            found = advise(need, work, model.scores)
            after = f"{found.second} takes {found.ratio:.1f}×" if found.second else "the only one"
            cells.append(
                {
                    "winner": found.winner,
                    "time": f"{figure(found.milliseconds)} ms",
                    "cost": _cost(found),
                    "next": after,
                }
                if found.winner
                else {"winner": "nobody", "time": "", "cost": "", "next": ""}
            )
        rows.append({"work": work.name, "cells": cells})
    return rows


def _cost(found: Advice) -> str:
    if not found.need.picture:
        wrong = max(score.wrong for score in found.scores)
        return f"{share(wrong)} wrong" if wrong else "0 wrong"
    codes = [score.codes for score in found.scores if score.codes is not None]
    return f"{min(codes):.1f} to {max(codes):.1f} codes"


def _prices(model: SpeedErrorModel) -> list[dict[str, Any]]:
    """What everyone takes and errs by on the middle height field and on the largest of each object."""
    fields = [work for work in model.works if work.kind == "height field"]
    objects = [work for work in shown_works(model) if work.kind == "object"]
    chosen = [*fields[len(fields) // 2 : len(fields) // 2 + 1], *objects]
    return [{"work": work, "rows": _price_rows(model, work)} for work in chosen]


def _price_rows(model: SpeedErrorModel, work: WorkFacts) -> list[dict[str, Any]]:
    exact = advise(NEEDS[0], work, model.scores)
    rows = []
    for contender in model.contenders:
        mine = [s for s in model.scores if s.work == work.name and s.contender == contender.label]
        if not mine:
            continue
        depth = _mean([s.depth.milliseconds for s in mine if s.depth])
        wrong, codes = [s.wrong for s in mine], [s.codes for s in mine if s.codes is not None]
        rows.append(
            {
                "label": contender.label,
                "depth": figure(depth),
                "ratio": f"{depth / exact.milliseconds:.1f}×" if depth and exact.milliseconds else "–",
                "both": figure(_mean([s.both.milliseconds for s in mine if s.both])),
                "wrong": "0" if not max(wrong) else f"{_percent(min(wrong))} to {_percent(max(wrong))} %",
                "rmse": figure(max(s.rmse for s in mine)),
                "codes": f"{min(codes):.1f} to {max(codes):.1f}" if codes else "–",
            }
        )
    return rows


def _percent(part: float) -> str:
    return share(part).removesuffix(" %")


def shown_works(model: SpeedErrorModel) -> list[WorkFacts]:
    """Return the smallest, middle and largest height field, and the largest of each object."""
    fields = [work for work in model.works if work.kind == "height field"]
    chosen = {n: fields[n] for n in (0, len(fields) // 2, len(fields) - 1)} if fields else {}
    objects = _objects(model)
    return [*chosen.values(), *objects.values()]


def _objects(model: SpeedErrorModel) -> dict[str, WorkFacts]:
    """Return the largest of each object, all layers, by name."""
    whole = [work for work in model.works if work.kind == "object" and not work.name.endswith(FIRST)]
    return {work.name.rpartition(" ")[0]: work for work in whole}


def _layers(model: SpeedErrorModel) -> list[dict[str, Any]]:
    """What all layers cost and bring beside the first alone: of every object, with the first setting of all."""
    label, rows = model.contenders[0].label, []
    for work in model.works:
        whole = work.name.removesuffix(FIRST)
        if work.kind == "object" and any(each.name == whole + FIRST for each in model.works):
            mine = [s for s in model.scores if (s.work, s.contender) == (work.name, label)]
            if mine:
                rows.append({"work": work, "label": label, **_total(label, mine, 0.0, 0.0, model)})
    return rows


def _advice(model: SpeedErrorModel) -> list[dict[str, Any]]:
    """One row for each thing and view: the winner of every need, its time, and the next."""
    choices = {(c.work, c.view, c.need): c for c in model.choices}
    scores = {(s.work, s.view, s.contender): s for s in model.scores}
    rows = []
    for work in shown_works(model):
        for view in work.views:
            cells = []
            for need in NEEDS:
                choice = choices[work.name, view, f"{need.title}: {need.words}"]
                if choice.winner is None:
                    cells.append({"winner": "nobody", "note": "", "next": ""})
                    continue
                score = scores[work.name, view, choice.winner]
                cost = f"{score.codes:.1f} codes" if need.picture and score.codes is not None else _depth_cost(score)
                after = (
                    f"{choice.second} takes {choice.ratio:.1f}×" if choice.second and choice.ratio else "the only one"
                )
                note = f"{figure(choice.milliseconds)} ms · {cost}"
                cells.append({"winner": choice.winner, "note": note, "next": after})
            rows.append({"work": work.name, "view": view, "cells": cells})
    return rows


def _depth_cost(score: Score) -> str:
    return f"{share(score.wrong)} wrong" + (f", {figure(score.rmse)} texels" if score.rmse > 1e-3 else "")


def _paretos(model: SpeedErrorModel) -> list[dict[str, Any]]:
    fields = [work for work in model.works if work.kind == "height field"]
    objects = _objects(model)
    middle = fields[len(fields) // 2]
    others = [work for work in (fields[0], fields[-1]) if work.name != middle.name]
    found = [_pareto(model, middle, colour, True) for colour in (False, True)]
    found += [_pareto(model, work, True, True) for work in objects.values()]
    found += [_pareto(model, work, colour, False) for work in others for colour in (False, True)]
    return found + [_pareto(model, work, False, False) for work in objects.values()]


def _pareto(model: SpeedErrorModel, work: WorkFacts, colour: bool, opened: bool) -> dict[str, Any]:
    title = f"{work.name}: {'colour' if colour else 'depth'}"
    return {"title": title, "open": opened, "svg": _safe(pareto_plot(model, work.name, work.views, colour))}


def _safe(svg: str) -> Any:
    from markupsafe import Markup

    return Markup(svg)


def _growth(model: SpeedErrorModel) -> dict[str, Any]:
    series = ["texels grow", "both grow"]
    rows = [curve for curve in model.growth if curve.series in series and curve.slope is not None]
    main = {each.label for each in model.contenders if each.main}
    return {
        "svg": _safe(growth_plot(model, series)),
        "main": sorted((curve for curve in rows if curve.contender in main), key=lambda curve: curve.series),
        "others": [curve for curve in rows if curve.contender not in main],
    }


def _regions(model: SpeedErrorModel) -> list[dict[str, Any]]:
    """One row for each region of the epipole: slope and greatest factor per doubling of every renderer."""
    curves = [curve for curve in model.growth if curve.series.startswith("epipole ") and curve.slope is not None]
    names = list(dict.fromkeys(curve.contender for curve in curves))
    rows = []
    for series in dict.fromkeys(curve.series for curve in curves):
        mine = {curve.contender: curve for curve in curves if curve.series == series}
        rows.append({"region": series.removeprefix("epipole "), "curves": [mine.get(name) for name in names]})
    plots = [_safe(region_plot([curve for curve in curves if curve.contender == name])) for name in names]
    return [{"names": names, "rows": rows, "plots": plots}] if rows else []


def _pictures(run: SpeedRun) -> list[dict[str, Any]]:
    """Return the pictures of each thing and view, beside what they cost."""
    scores = {(s.work, s.view, s.contender): s for s in run.model.scores}
    groups: dict[tuple[str, str], list[dict[str, str]]] = {}
    for shown in run.shown:
        score = scores[shown.work, shown.view, shown.contender]
        timing = score.depth or score.both
        taken = figure(timing.milliseconds if timing else None)
        note = f"{share(score.wrong)} wrong · rms {figure(score.rmse)} texels · {taken} ms"
        item = {"label": shown.contender, "note": note, "image": draw_errors(shown)}
        groups.setdefault((shown.work, shown.view), []).append(item)
    return [{"title": f"{work}, {view}", "items": items} for (work, view), items in groups.items()]


def _totals(model: SpeedErrorModel) -> list[dict[str, Any]]:
    """One table for each thing: every contender over all views."""
    tables = []
    for work in model.works:
        rows = []
        for contender in model.contenders:
            mine = [s for s in model.scores if s.work == work.name and s.contender == contender.label]
            if mine:
                prepared = next(p for p in model.preparations if p.work == work.name and p.contender == contender.label)
                rows.append(_total(contender.label, mine, prepared.milliseconds, prepared.bytes / work.texels, model))
        tables.append({"work": work, "rows": rows, "open": work.name in {w.name for w in shown_works(model)[1:2]}})
    return tables


def _total(label: str, scores: Sequence[Score], prepared: float, held: float, model: SpeedErrorModel) -> dict[str, Any]:
    pixels = model.width * model.height
    depth = _mean([s.depth.milliseconds for s in scores if s.depth])
    both = _mean([s.both.milliseconds for s in scores if s.both])
    spreads = [(t.high - t.low) / t.milliseconds for s in scores for t in (s.depth or s.both,) if t]
    codes = [s.codes for s in scores if s.codes is not None]
    return {
        "label": label,
        "depth": figure(depth),
        "rays": figure(pixels / depth / 1e3 if depth else None),
        "both": figure(both),
        "spread": f"{100 * max(spreads, default=0):.0f} %",
        "wrong": share(max(s.wrong for s in scores)),
        "rmse": figure(max(s.rmse for s in scores)),
        "codes": figure(max(codes, default=None)),
        "meant": share(max(s.meant_wrong for s in scores)),
        "prepared": figure(prepared),
        "bytes": figure(held),
    }


def _mean(values: Sequence[float]) -> float | None:
    """Geometric mean."""
    return math.exp(sum(map(math.log, values)) / len(values)) if values else None
