"""``hard_cases.json``: the cells as columns, names as numbers into lists, figures to four digits."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

from pydantic import Field, create_model

from ibrpipe.bench.hard_cases.results import CaseFacts, Cell, Figures, HardCasesModel, Limits, SettingFacts
from ibrpipe.config import Document
from ibrpipe.engine.machine import Machine
from ibrpipe.io.manifest import write_text

DIGITS = 4


class CellColumns(Document):
    """All cells; entry i of every column belongs to cell i."""

    case: list[int] = Field(description="Which of `cases`")
    setting: list[int] = Field(description="Which of `settings`; -1 = making the texture itself")
    input: list[int] = Field(description="Type of all arrays that the renderer was given: which of `inputs`")
    bits: list[int] = Field(description="Bits of stored depth: 8, 16, or 32 for float32")
    status: list[int] = Field(description="Which of `statuses`")
    message: list[int] = Field(description="The error met, or why the case does not apply: which of `messages`")
    same_bytes: list[int] = Field(description="One thread and all threads gave the same bytes: 1, 0; -1 = not rendered")
    depth_bytes: list[int] = Field(description="Bytes of stored depth; -1 = not rendered")
    limits: list[int] = Field(description="Which of `limits` the figures were held to; -1 = not rendered")


def _figure_columns() -> Any:
    columns: dict[str, Any] = {
        name: (list[field.annotation], Field(description=field.description))  # type: ignore[name-defined]
        for name, field in Figures.model_fields.items()
    }
    return create_model(
        "FigureColumns", __base__=Document, cell=(list[int], Field(description="Number of the cell")), **columns
    )


if TYPE_CHECKING:
    FigureColumns: TypeAlias = Any
else:
    FigureColumns = _figure_columns()


class Failure(Document):
    """What of a cell is beyond its limit."""

    cell: int = Field(description="Number of the cell")
    what: list[str] = Field(description="In words")


class HardCasesFile(Document):
    """All cells, and what they were measured on."""

    schema_version: Literal[4] = 4
    machine: Machine = Field(description="Processor, threads, versions")
    threads: list[int] = Field(description="Numbers of threads with which every cell was rendered")
    seconds: float = Field(ge=0, description="Time of the whole run, s")
    cases: list[CaseFacts] = Field(description="Cases, group by group")
    settings: list[SettingFacts] = Field(description="Settings, in the order of the table's columns")
    inputs: list[str] = Field(description="Types of arrays")
    statuses: list[str] = Field(description="pass, fail, refused (a clear error, permitted), not applicable")
    messages: list[str] = Field(description="Errors met, and reasons why cases do not apply")
    limits: list[Limits] = Field(description="Limits, each listed once")
    failures: list[Failure] = Field(description="Of the cells that fail")
    cells: CellColumns = Field(description="All cells, by case")
    figures: FigureColumns = Field(
        description="Errors of the cells that were rendered, to four digits; null = nothing to measure"
    )


def pack(model: HardCasesModel) -> HardCasesFile:
    """Return what the file holds."""
    cases, settings = [case.name for case in model.cases], [setting.label for setting in model.settings]
    inputs, statuses = _distinct(c.input for c in model.cells), _distinct(c.status for c in model.cells)
    messages = _distinct(c.message for c in model.cells)
    limits = {_key(c.limits): c.limits for c in model.cells if c.limits is not None}
    numbers = {key: number for number, key in enumerate(limits)}
    seen = [(number, c.figures) for number, c in enumerate(model.cells) if c.figures is not None]
    columns: dict[str, list[Any]] = {name: [_short(getattr(f, name)) for _, f in seen] for name in Figures.model_fields}
    return HardCasesFile(
        machine=model.machine,
        threads=model.threads,
        seconds=_short(model.seconds),
        cases=model.cases,
        settings=model.settings,
        inputs=list(inputs),
        statuses=list(statuses),
        messages=list(messages),
        limits=[_rounded(each) for each in limits.values()],
        failures=[Failure(cell=n, what=c.failures) for n, c in enumerate(model.cells) if c.failures],
        cells=CellColumns(
            case=_places(cases, (c.case for c in model.cells)),
            setting=_places(settings, (c.setting for c in model.cells)),
            input=[inputs[c.input] for c in model.cells],
            bits=[c.bits for c in model.cells],
            status=[statuses[c.status] for c in model.cells],
            message=[messages[c.message] for c in model.cells],
            same_bytes=[-1 if c.same_bytes is None else int(c.same_bytes) for c in model.cells],
            depth_bytes=[-1 if c.depth_bytes is None else c.depth_bytes for c in model.cells],
            limits=[-1 if c.limits is None else numbers[_key(c.limits)] for c in model.cells],
        ),
        figures=FigureColumns(cell=[number for number, _ in seen], **columns),
    )


def unpack(file: HardCasesFile) -> HardCasesModel:
    """Return the cells one by one again."""
    columns, cells = file.cells, []
    names = list(Figures.model_fields)
    rows = zip(*(getattr(file.figures, name) for name in names), strict=True)
    figures = {cell: Figures(**dict(zip(names, row))) for cell, row in zip(file.figures.cell, rows, strict=True)}
    failures = {each.cell: each.what for each in file.failures}
    for n, case in enumerate(columns.case):
        setting, limits, same, depth = (
            column[n] for column in (columns.setting, columns.limits, columns.same_bytes, columns.depth_bytes)
        )
        found: dict[str, Any] = {
            "case": file.cases[case].name,
            "setting": "load" if setting < 0 else file.settings[setting].label,
            "input": file.inputs[columns.input[n]],
            "bits": columns.bits[n],
            "status": file.statuses[columns.status[n]],
            "failures": failures.get(n, []),
            "message": file.messages[columns.message[n]],
            "same_bytes": None if same < 0 else bool(same),
            "depth_bytes": None if depth < 0 else depth,
            "figures": figures.get(n),
            "limits": None if limits < 0 else file.limits[limits],
        }
        cells.append(Cell(**found))
    return HardCasesModel(
        machine=file.machine,
        threads=file.threads,
        cases=file.cases,
        settings=file.settings,
        cells=cells,
        seconds=file.seconds,
    )


def write_hard_cases(path: Path, model: HardCasesModel) -> None:
    """Write the file in one step, a column on a line."""
    write_text(path, lines_of(pack(model).model_dump(mode="json")) + "\n")


def read_hard_cases(path: Path) -> HardCasesModel:
    """Read what `write_hard_cases` wrote."""
    return unpack(HardCasesFile.model_validate_json(path.read_text(encoding="utf-8")))


def lines_of(value: Any, indent: str = "") -> str:
    """Return JSON in which mappings, and lists of mappings, are broken into lines and other lists are not."""
    if isinstance(value, dict) and value:
        parts = [f"{json.dumps(key)}: {lines_of(each, indent + ' ')}" for key, each in value.items()]
        brackets = "{}"
    elif isinstance(value, list) and value and isinstance(value[0], (dict, str)):
        parts, brackets = [json.dumps(each, ensure_ascii=False) for each in value], "[]"
    else:
        return json.dumps(value, ensure_ascii=False, separators=(",", ":"))
    return brackets[0] + ",".join(f"\n{indent} {part}" for part in parts) + f"\n{indent}" + brackets[1]


def _distinct(values: Iterable[str]) -> dict[str, int]:
    return {value: number for number, value in enumerate(dict.fromkeys(values))}


def _places(names: list[str], wanted: Iterable[str]) -> list[int]:
    known = {name: number for number, name in enumerate(names)}
    return [known.get(name, -1) for name in wanted]


def _short(value: Any) -> Any:
    return float(f"{value:.{DIGITS}g}") if isinstance(value, float) else value


def _rounded(limits: Limits) -> Limits:
    return Limits(**{name: _short(getattr(limits, name)) for name in Limits.model_fields})


def _key(limits: Limits) -> str:
    return _rounded(limits).model_dump_json()
