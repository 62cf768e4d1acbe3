"""What other stages ask of a finished calibration."""

from __future__ import annotations

import json
from pathlib import Path

from ibrpipe.errors import FormatError


def read_world(folder: Path) -> str | None:
    """Return where the world of a calibrate folder comes from; None where it has no cameras of its own.

    Raises
    ------
    FormatError
        ``calibration.json`` is damaged.
    """
    path = folder / "calibration.json"
    if not path.is_file():
        return None
    try:
        world = json.loads(path.read_text(encoding="utf-8")).get("world")
    except (ValueError, AttributeError) as error:
        raise FormatError(f"{path}: not what the calibrate stage writes ({error}); run it again") from error
    return None if world is None else str(world)
