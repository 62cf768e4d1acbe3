"""What a run's report says of its held-out photos."""

from __future__ import annotations

from pathlib import Path

from pydantic import BaseModel, ValidationError

from ibrpipe.errors import FormatError

#: in a run's folder
METRICS = "report/metrics.json"


class _Scores(BaseModel):
    psnr: float | None = None
    psnr_covered: float | None = None


class _View(BaseModel):
    name: str
    renderers: dict[str, _Scores]


class _Metrics(BaseModel):
    """The few keys of ``metrics.json`` that pages show; others are the report's own matter."""

    renderer: str
    headline: str = "mask"
    views: list[_View]


def measured_psnr(run: Path) -> dict[str, float]:
    """Return the PSNR of held-out views by name, dB, as the report of a run states it; empty without a report.

    Raises
    ------
    FormatError
        The report's figures are damaged.
    """
    path = run / METRICS
    return scores_of(path.read_bytes(), str(path)) if path.is_file() else {}


def scores_of(content: bytes | str, place: str) -> dict[str, float]:
    """Return the PSNR of held-out views by name, dB, of the text of ``metrics.json`` at a place; raises as above."""
    try:
        metrics = _Metrics.model_validate_json(content)
    except ValidationError as error:
        raise FormatError(f"{place}: is no list of scores; run the evaluate stage again") from error
    key = "psnr_covered" if metrics.headline == "covered" else "psnr"
    scores = {view.name: view.renderers.get(metrics.renderer, _Scores()) for view in metrics.views}
    found = {name: getattr(score, key) for name, score in scores.items()}
    return {name: value for name, value in found.items() if value is not None}
