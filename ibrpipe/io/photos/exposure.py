"""Exposure of each photo relative to the others, in stops, from a CSV or from EXIF."""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping, Sequence
from pathlib import Path

from ibrpipe.errors import CaptureError, FormatError
from ibrpipe.io.photos.image_files import ImageHeader
from ibrpipe.io.untrusted.boundary import reader

#: the file in a capture, and its column
EXPOSURES = "exposure.csv"
COLUMN = "relative_exposure_stops"


@reader("write it again")
def read_exposure_csv(path: Path) -> dict[str, float]:
    """Read stops relative to the capture's reference exposure.

    Parameters
    ----------
    path : Path
        CSV with a header; columns ``file`` and ``relative_exposure_stops`` (+1 = twice the light), others are ignored.

    Returns
    -------
    dict
        File name as written -> stops.

    Raises
    ------
    FormatError
        A column is missing, a value is no finite number, a file is named twice.
    """
    try:
        with path.open(encoding="utf-8-sig", newline="") as source:
            rows = list(csv.DictReader(source))
    except (UnicodeDecodeError, csv.Error) as error:
        raise FormatError(f"{path}: is not a CSV file ({error}); expected columns file, {COLUMN}") from error
    columns = list(rows[0]) if rows else []
    for name in ("file", COLUMN):
        if name not in columns:
            raise FormatError(f"{path}: has columns {columns}; expected a column named {name!r}")
    stops: dict[str, float] = {}
    for number, row in enumerate(rows, 2):
        value = _number(row[COLUMN])
        if value is None:
            raise FormatError(f"{path}, line {number}: {COLUMN} is {row[COLUMN]!r}; expected a finite number of stops")
        if row["file"] in stops:
            raise FormatError(f"{path}, line {number}: {row['file']} is named twice; keep one line per photo")
        stops[row["file"]] = value
    return stops


def gains_from_csv(stops: Mapping[str, float], files: Sequence[str], path: Path) -> list[float]:
    """Linear gain 2^-stops of every photo, looked up by its name below ``images/`` or its bare file name.

    Raises
    ------
    CaptureError
        A photo has no line.
    """
    missing = [file for file in files if file not in stops and Path(file).name not in stops]
    if missing:
        raise CaptureError(
            f"{path}: {len(missing)} of {len(files)} photos have no line, the first is {missing[0]}; "
            "add them or set exposure: none"
        )
    return [2.0 ** -stops.get(file, stops.get(Path(file).name, 0.0)) for file in files]


def exif_stops(header: ImageHeader) -> float | None:
    """log2 of exposure time x ISO / f-number squared, or None where EXIF does not tell all three."""
    time = header.metadata.get("ExposureTime", 0.0)
    aperture = header.metadata.get("FNumber", 0.0)
    iso = header.metadata.get("Exif:PhotographicSensitivity", 0.0)
    if min(time, aperture, iso) <= 0:
        return None
    return math.log2(time * iso / aperture**2)


def gains_from_exif(headers: Sequence[ImageHeader]) -> list[float] | None:
    """Linear gains that bring all photos to the median exposure, or None where a photo lacks the figures."""
    stops = [exif_stops(header) for header in headers]
    known = sorted(value for value in stops if value is not None)
    if not known or len(known) < len(stops):
        return None
    middle = known[(len(known) - 1) // 2]
    return [2.0 ** (middle - value) for value in stops if value is not None]


#: EXIF figures that make an exposure, by what people call them, and how stops count them
_FIGURES = {
    "exposure time": ("ExposureTime", 1.0),
    "f-number": ("FNumber", -2.0),
    "ISO": ("Exif:PhotographicSensitivity", 1.0),
}


def gains_from_partial_exif(headers: Sequence[ImageHeader], files: Sequence[str]) -> tuple[list[float] | None, str]:
    """Linear gains as `gains_from_exif`, where photos lack some of the figures, and what is to be told of that.

    A figure that no photo has (a manual lens states no f-number) counts as the same for all; one that few photos lack
    counts as the median of the others'. Where half of the photos or more have no exposure time, nothing is known.

    Parameters
    ----------
    headers : sequence of ImageHeader
    files : sequence of str
        Names of the photos, for what is told.
    """
    stops, told = [0.0] * len(headers), []
    times = sum(header.metadata.get("ExposureTime", 0.0) > 0 for header in headers)
    if 2 * times <= len(headers):
        text = f"only {times} of {len(headers)} photos state an exposure time in EXIF: exposure is not compensated"
        return None, text if times else ""
    for name, (key, power) in _FIGURES.items():
        values = [header.metadata.get(key, 0.0) for header in headers]
        known = sorted(value for value in values if value > 0)
        lack = [file for file, value in zip(files, values) if value <= 0]
        if not known:
            told.append(f"no photo states its {name}, which counts as the same for all")
            continue
        middle = known[(len(known) - 1) // 2]
        if lack:
            told.append(f"{len(lack)} of {len(files)} photos state no {name} ({lack[0]}), {middle:g} is taken for them")
        filled = (value if value > 0 else middle for value in values)
        stops = [stop + power * math.log2(value) for stop, value in zip(stops, filled)]
    middle = sorted(stops)[(len(stops) - 1) // 2]
    return [2.0 ** (middle - value) for value in stops], "exposure from EXIF: " + "; ".join(told)


def _number(text: str | None) -> float | None:
    try:
        value = float(text or "")
    except ValueError:
        return None
    return value if math.isfinite(value) else None
