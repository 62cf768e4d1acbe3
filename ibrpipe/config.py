"""Base classes of all settings and documents: frozen, no unknown keys, every field described."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict


class StageConfig(BaseModel):
    """Settings of one stage. A misspelt key is an error, a value cannot change after loading."""

    model_config = ConfigDict(frozen=True, extra="forbid", validate_default=True)


class Document(BaseModel):
    """What a JSON file holds, or a part of it: the one description that writes, reads and checks the file."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)
