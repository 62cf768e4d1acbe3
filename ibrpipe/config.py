"""Base classes of all settings and documents: frozen, no unknown keys, every field described."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any, Self

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    PlainSerializer,
    ValidationError,
    ValidatorFunctionWrapHandler,
    WrapValidator,
)

from ibrpipe.errors import FormatError, MissingFileError


class StageConfig(BaseModel):
    """Settings of one stage. A misspelt key is an error, a value cannot change after loading."""

    model_config = ConfigDict(frozen=True, extra="forbid", validate_default=True)


class Document(BaseModel):
    """What a JSON file holds, or a part of it: the one description that writes, reads and checks the file."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    def to_json(self, indent: int = 1) -> str:
        """Return the text of the file, without a last line break: what was set, in the order of the fields."""
        content = self.model_dump(mode="json", by_alias=True, exclude_unset=True)
        return json.dumps(content, indent=indent, ensure_ascii=False)

    @classmethod
    def read(cls, path: Path, wrong: str, stage: str) -> Self:
        """Read a file that a stage writes; `wrong` says of a damaged one what it is not.

        Raises
        ------
        MissingFileError
            There is no such file.
        FormatError
            It holds something else; the message names the first place that is wrong.
        """
        try:
            if path.exists() and not path.is_file():
                raise FormatError(f"{path}: {wrong} (no file); run the {stage} stage again")
            return cls.model_validate_json(path.read_bytes())
        except FileNotFoundError as error:
            raise MissingFileError(f"{path}: does not exist; run the {stage} stage first") from error
        except ValidationError as error:
            raise FormatError(f"{path}: {wrong} ({_first_problem(error)}); run the {stage} stage again") from error


def _first_problem(error: ValidationError) -> str:
    problem = error.errors(include_url=False)[0]
    where = ".".join(map(str, problem["loc"]))
    return f"{where}: {problem['msg']}" if where else problem["msg"]


def _as_it_is(value: Any, check: ValidatorFunctionWrapHandler) -> Any:
    checked = check(value)
    return value if type(value) is int else checked


def _itself(value: Any) -> Any:
    return value


#: a number that is written as it was given: 3 stays 3, where a float would become 3.0
Number = Annotated[float, WrapValidator(_as_it_is), PlainSerializer(_itself)]
#: a figure that is written with six significant digits: enough to read, the same on every machine
Rounded = Annotated[float, PlainSerializer(lambda value: float(f"{value:.6g}"))]
Share = Annotated[float, Field(ge=0, le=1)]
RoundedShare = Annotated[Rounded, Field(ge=0, le=1)]
Vector = Annotated[list[float], Field(min_length=3, max_length=3)]
Matrix33 = Annotated[list[Vector], Field(min_length=3, max_length=3)]
Matrix34 = Annotated[list[Annotated[list[float], Field(min_length=4, max_length=4)]], Field(min_length=3, max_length=3)]
