"""What ``photometry.json`` holds."""

from __future__ import annotations

from pydantic import Field

from ibrpipe.config import Document
from ibrpipe.io.documents.views import Factors


class PhotoGain(Document):
    """What a photo's light is multiplied by."""

    name: str = Field(description="Of the view")
    stops: float = Field(description="By which it is brighter than the middle of the photos; negative = darker")
    factors: Factors = Field(description="Of linear red, green and blue, beside the gain that ingest gave it")


class Photometry(Document):
    """``photometry/photometry.json``."""

    applied: bool = Field(description="The photos are brought together by these factors")
    why: str = Field(description="What decided that")
    before: float | None = Field(
        description="Median disagreement of photos about points that three or more show, stops; null = no such points"
    )
    after: float | None = Field(description="The same with the factors")
    train: list[PhotoGain] = Field(description="Photos that the asset is made from")
    test: list[PhotoGain] = Field(description="Held-out photos, by the colours of the others; empty = not applied")
