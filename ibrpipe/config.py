"""Base class of all settings: frozen, no unknown keys, every field described."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict


class StageConfig(BaseModel):
    """Settings of one stage. A misspelt key is an error, a value cannot change after loading."""

    model_config = ConfigDict(frozen=True, extra="forbid", validate_default=True)
