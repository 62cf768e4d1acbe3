"""Templates of the pages, and the words that they share."""

from __future__ import annotations

from importlib import resources
from typing import Any

from ibrpipe.types import Array


def fill(name: str, **values: Any) -> str:
    """Return the template `name` of this package filled with `values`."""
    from jinja2 import Environment, FunctionLoader, StrictUndefined

    environment = Environment(
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        loader=FunctionLoader(lambda file: resources.files(__package__).joinpath(file).read_text(encoding="utf-8")),
    )
    environment.filters.update(figure=figure, share=share)
    return environment.get_template(name).render(**values)


def figure(value: float | None) -> str:
    """Return a number with two digits that count: 0.0012, 1.5e-07, 23; a dash for None."""
    if value is None:
        return "–"
    if value == 0:
        return "0"
    if 1e-3 <= abs(value) < 9999.5:
        digits = max(0, 1 - int(f"{value:e}".partition("e")[2]))
        return f"{value:.{digits}f}"
    return f"{value:.1e}".replace("e-0", "e-").replace("e+0", "e")


def share(part: float, whole: float = 1.0) -> str:
    """Return a share in percent: 0 %, 0.003 %, 12 %."""
    percent = 100.0 * part / max(whole, 1e-300)
    return f"{figure(percent)} %"


def picture(values: Array, width: int) -> str:
    """Return (H, W, 3) uint8 as the data URI of a PNG, enlarged to about `width` pixels with hard edges."""
    from base64 import b64encode

    import cv2

    factor = max(1, round(width / values.shape[1]))
    large = values.repeat(factor, axis=0).repeat(factor, axis=1)
    _, encoded = cv2.imencode(".png", large[:, :, ::-1])
    return "data:image/png;base64," + b64encode(encoded.tobytes()).decode("ascii")
