"""Documents: written in the order of the fields, read back, and a damaged one told in one line."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Literal

import pytest
from pydantic import Field, ValidationError

from ibrpipe.config import Document, Number
from ibrpipe.errors import FormatError, MissingFileError


class Part(Document):
    name: str = Field(description="Name")
    length: float | None = Field(None, description="Length")


class Whole(Document):
    schema_version: Literal[1] = Field(alias="schema", description="Version")
    parts: list[Part] = Field(description="Parts")
    figures: dict[str, Number] = Field(default={}, description="Figures")


WHOLE = Whole(figures={"count": 3, "mean": 2.5}, parts=[Part(name="café"), Part(name="b", length=1)], schema=1)


def test_what_was_set_is_written_in_the_order_of_the_fields() -> None:
    content = {
        "schema": 1,
        "parts": [{"name": "café"}, {"name": "b", "length": 1.0}],
        "figures": {"count": 3, "mean": 2.5},
    }
    assert WHOLE.to_json() == json.dumps(content, indent=1, ensure_ascii=False)
    assert WHOLE.to_json(2) == json.dumps(content, indent=2, ensure_ascii=False)


def test_it_is_read_back(tmp_path: Path) -> None:
    path = tmp_path / "whole.json"
    path.write_text(WHOLE.to_json(), encoding="utf-8")
    assert Whole.read(path, "not a whole", "make") == WHOLE


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", r"whole\.json: not a whole \(Invalid JSON: EOF .*\); run the make stage again"),
        ("[]", r"not a whole \(Input should be .*\); run the make stage again"),
        ('{"schema": 2, "parts": []}', r"\(schema: Input should be 1\)"),
        ('{"schema": 1, "parts": [{"name": 3}]}', r"\(parts\.0\.name: Input should be a valid string\)"),
        ('{"schema": 1, "parts": [], "size": 1}', r"\(size: Extra inputs are not permitted\)"),
    ],
)
def test_a_damaged_one_is_told_in_one_line(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "whole.json"
    path.write_text(text)
    with pytest.raises(FormatError, match=message) as caught:
        Whole.read(path, "not a whole", "make")
    assert "\n" not in str(caught.value)


def test_a_missing_one_is_told(tmp_path: Path) -> None:
    with pytest.raises(MissingFileError, match=r"whole\.json: does not exist; run the make stage first"):
        Whole.read(tmp_path / "whole.json", "not a whole", "make")


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_what_json_cannot_say_is_refused(value: float) -> None:
    with pytest.raises(ValidationError):
        Part(name="a", length=value)
