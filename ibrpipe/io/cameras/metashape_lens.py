"""Sensors of Agisoft Metashape's ``cameras.xml`` as lenses."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from ibrpipe.errors import CaptureError, FormatError
from ibrpipe.io.cameras.lenses import Lens
from ibrpipe.io.cameras.transforms_lens import perspective_lens
from ibrpipe.types import Array

#: Skew over the focal length beyond which leaving it out would show
_SKEW = 1e-4


def sensor_lens(path: Path, sensor: ElementTree.Element | None, label: str) -> Lens:
    """Return Brown's model of a sensor's adjusted calibration; Metashape's p1 and p2 are COLMAP's the other way round.

    Parameters
    ----------
    path : Path
        For messages, as is `label`, the camera's.
    sensor : Element or None
        May hold several calibrations: what was known before alignment ("initial") and what it has found ("adjusted").

    Raises
    ------
    FormatError, CaptureError
        No sensor, no calibration, or a kind of lens that is not supported.
    """
    if sensor is None:
        raise FormatError(f"{path}: camera {label} names a sensor that is not there; export the cameras again")
    calibration, size = _adjusted(sensor), sensor.find("resolution")
    if calibration is None or size is None:
        raise CaptureError(f"{path}: the sensor of {label} has no calibration; align the photos and export again")
    kind = calibration.get("type") or sensor.get("type", "frame")
    if sensor.get("type", "frame") != "frame" or kind != "frame":
        kind = kind if kind != "frame" else sensor.get("type", "frame")
        raise CaptureError(
            f"{path}: the sensor of {label} is of type {kind}; expected frame: export undistorted photos"
        )
    width, height = int(size.get("width", "0")), int(size.get("height", "0"))
    values = {child.tag: child.text for child in calibration}
    try:
        f, cx, cy, b1, b2, k1, k2, k3, k4, p1, p2 = _values(values)
    except ValueError as error:
        raise FormatError(f"{path}: calibration of {label}: {error}; export the cameras again") from error
    if k4 or abs(b2) > _SKEW * f:
        raise CaptureError(
            f"{path}: the calibration of {label} has skew (b2 = {b2:g}) or k4 = {k4:g}, which no model here has; "
            "switch them off in Metashape's optimisation, or export undistorted photos"
        )
    model, params = perspective_lens(f + b1, f, width / 2.0 + cx, height / 2.0 + cy, (k1, k2, p2, p1, k3))
    return Lens(model, params, width, height)


def numbers_of(path: Path, element: ElementTree.Element, count: int, what: str) -> Array:
    """Return the numbers of an element, (count,) float64.

    Raises
    ------
    FormatError
        They are none, or not as many.
    """
    try:
        numbers = np.array([float(word) for word in (element.text or "").split()])
    except ValueError as error:
        raise FormatError(f"{path}: {element.tag} of {what}: {error}; export the cameras again") from error
    if len(numbers) != count:
        raise FormatError(f"{path}: {element.tag} of {what} holds {len(numbers)} numbers, expected {count}")
    return numbers


def _adjusted(sensor: ElementTree.Element) -> ElementTree.Element | None:
    """Return the calibration that alignment has found, else one that does not say, else the initial one."""
    order = {"adjusted": 0, None: 1, "initial": 3}
    found = sorted(sensor.findall("calibration"), key=lambda each: order.get(each.get("class"), 2))
    return found[0] if found else None


def _values(values: dict[str, str | None]) -> Sequence[float]:
    names = ("f", "cx", "cy", "b1", "b2", "k1", "k2", "k3", "k4", "p1", "p2")
    return [float(values.get(name) or 0.0) for name in names]
