"""What ``run.json`` holds."""

from __future__ import annotations

from typing import Any

from pydantic import Field

from ibrpipe.config import Document


class RunDocument(Document):
    """``run.json``: what the last ``ibrpipe run`` in this folder was asked for."""

    pipeline: str = Field(description="Name of the pipeline")
    seed: int = Field(ge=0, description="The one seed")
    capture: str | None = Field(description="Capture folder, absolute")
    settings: dict[str, dict[str, Any]] = Field(description="Stage to all its settings, defaults included")
