"""Stage calibrate: photos without cameras in, a COLMAP model out; given cameras are left as they are unless asked.

It comes before ingest, because views need cameras.
"""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import numba
from pydantic import BaseModel, ConfigDict, Field, model_validator

from ibrpipe.calibration.child_process import run_child
from ibrpipe.calibration.job import Job, write_job
from ibrpipe.calibration.photos import photos_of, without_cameras
from ibrpipe.calibration.results import WEAK, summary
from ibrpipe.config import StageConfig
from ibrpipe.engine.provenance import count_child
from ibrpipe.engine.run_folder import kept_folder
from ibrpipe.engine.stage import Stage, StageOutputs, artifact
from ibrpipe.errors import CaptureError, MissingFileError
from ibrpipe.io.cameras.sources import has_cameras, has_test
from ibrpipe.io.documents.calibration import Calibration
from ibrpipe.io.manifest import write_text
from ibrpipe.progress import listener

SCHEMA: Literal[1] = 1
#: Module that runs in the child process
WORKER = "ibrpipe.calibration.worker"
Pixel = tuple[float, float]
Model = Literal[
    "SIMPLE_PINHOLE",
    "PINHOLE",
    "SIMPLE_RADIAL",
    "RADIAL",
    "OPENCV",
    "FULL_OPENCV",
    "SIMPLE_RADIAL_FISHEYE",
    "RADIAL_FISHEYE",
    "OPENCV_FISHEYE",
]
Dictionary = Annotated[str, Field(pattern=r"^DICT_[0-9A-Za-z_]+$")]


class KnownDistance(BaseModel):
    """A length between two points that are marked in photos."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    length: float = Field(gt=0, description="In the unit that the world shall have")
    start: dict[str, Pixel] = Field(min_length=2, description="Photo to pixel (x, y) of one end, two photos or more")
    end: dict[str, Pixel] = Field(min_length=2, description="The same of the other end")


class Markers(BaseModel):
    """ArUco markers or a ChArUco board in the photos."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    dictionary: Dictionary = Field("DICT_4X4_50", description="OpenCV's name of the set of markers")
    size: float = Field(gt=0, description="Edge of a marker's black square, in the unit that the world shall have")
    frame: int | None = Field(
        None, ge=0, description="Marker at the world's origin; null = the lowest number that is seen"
    )
    board: tuple[int, int] | None = Field(
        None, description="Squares of a ChArUco board, columns and rows; null = no board"
    )
    square: float | None = Field(None, gt=0, description="Edge of a square of the board")

    @model_validator(mode="after")
    def _board_is_whole(self) -> Markers:
        if (self.board is None) != (self.square is None):
            raise ValueError("board and square belong together; state both or neither")
        if self.board is not None and (min(self.board) < 2 or not self.size < (self.square or 0.0)):
            raise ValueError("a board has 2 x 2 squares or more, each larger than its marker")
        return self


class CalibrateConfig(StageConfig):
    """Settings of the calibrate stage."""

    mode: Literal["auto", "refine", "anew"] = Field(
        "auto", description="auto = only where cameras are missing; refine = adjust given ones; anew = find all again"
    )
    camera_model: Model = Field("SIMPLE_RADIAL", description="COLMAP's camera model of lenses that are not given")
    camera_params: tuple[float, ...] | None = Field(
        None, description="The lens's parameters in COLMAP's order, pixels, if they are known; they then stay fixed"
    )
    intrinsics: Literal["auto", "given", "unknown"] = Field(
        "auto",
        description="Lenses that the capture states: given = used, unknown = not used, auto = used except by mode anew",
    )
    share: Literal["auto", "all", "photo"] = Field(
        "auto", description="Who shares a lens: photos of one size and one lens tag, all of one size, or each its own"
    )
    refine_intrinsics: Literal["auto", "yes", "no"] = Field(
        "auto", description="Adjust lenses; auto = all but those that are known (refine: all)"
    )
    refine_principal_point: Literal["auto", "no"] = Field(
        "auto", description="Adjust where the optical axis meets the photo; auto = where the photos fix it well"
    )
    features: int = Field(8192, ge=256, le=65536, description="Features per photo at the most")
    max_size: int = Field(
        3200, ge=128, le=20000, description="Larger photos are searched at so many pixels along a side"
    )
    pairs: Literal["auto", "exhaustive", "near", "sequential"] = Field(
        "auto",
        description="Photos to compare: all; those that look alike; those and neighbours by name. auto: all up to 60",
    )
    neighbours: int = Field(24, ge=2, le=500, description="Photos that look alike each photo is compared with")
    overlap: int = Field(8, ge=1, le=100, description="Neighbours by name that sequential compares")
    mapper: Literal["auto", "incremental", "patient", "global"] = Field(
        "auto",
        description="Place photos one by one, the same on few matches, or all at once; auto = first, else last",
    )
    min_registered: float = Field(
        0.5, ge=0, le=1, description="Fail when a smaller share of the photos finds its camera, on 30 points or more"
    )
    align: Literal["auto", "none", "given", "positions", "gps", "markers"] = Field(
        "auto", description="What places the world; auto = given cameras, else markers, else positions, else none"
    )
    positions: Path | None = Field(None, description="CSV file with columns file, x, y, z: where the camera stood")
    markers: Markers | None = Field(None, description="Markers in the photos: dictionary, size, frame, board, square")
    distances: tuple[KnownDistance, ...] = Field((), description="Known lengths between points marked in photos")
    time_limit: float = Field(240.0, gt=0, le=100000, description="Minutes after which the search is given up")


@dataclass(frozen=True)
class Inputs:
    """A capture folder, the seed, and the folder to write to."""

    capture: Path
    seed: int
    out: Path


@dataclass(frozen=True)
class Outputs(StageOutputs):
    """What calibrate writes; a model only where it has found one."""

    calibration: Path = artifact("", "Folder of the calibrate stage.")
    calibration_document: Path = artifact("calibration.json", "What was found, and how well.", Calibration)
    model: Path | None = artifact("sparse/0", "COLMAP model of the cameras that were found.", optional=True)


def run(inputs: Inputs, config: CalibrateConfig) -> Outputs:
    """Write ``calibration.json``, and where cameras were searched ``sparse/0`` and ``summary.txt``.

    Raises
    ------
    MissingFileError, CaptureError, FormatError
        The photos do not suffice; the message says what to shoot.
    ResourceError
        The child process crashed, or took too long.
    """
    if not inputs.capture.is_dir():
        raise MissingFileError(f"{inputs.capture}: is no folder; give a capture folder with images/")
    root = inputs.capture.resolve()
    inputs.out.mkdir(parents=True, exist_ok=True)
    outputs = Outputs.below(inputs.out)
    if _all_given(root) and config.mode == "auto":
        document = Calibration(schema=SCHEMA, decision="given", reason="the capture has cameras")
        write_text(outputs.calibration_document, document.to_json(2) + "\n")
        return outputs.made()
    job = _job(root, inputs, config)
    work = Path(job.work)
    write_job(job, work / "job.json")
    shutil.rmtree(job.result, ignore_errors=True)
    told = listener()
    found = run_child(WORKER, work / "job.json", work / "log.txt", 60.0 * config.time_limit, told)
    count_child(found["peak_memory_bytes"])
    document = Calibration.model_validate({"schema": SCHEMA, **_decision(job), **found})
    _check(document, config, root)
    shutil.copytree(job.result, inputs.out, dirs_exist_ok=True)
    shutil.rmtree(job.result)
    write_text(outputs.calibration_document, document.to_json(2) + "\n")
    (inputs.out / "summary.txt").write_text(summary(document), encoding="utf-8")
    return outputs.made()


def _all_given(root: Path) -> bool:
    """Say whether nothing is missing: photos and, where there is one, the test folder have cameras."""
    return has_cameras(root) and (not has_test(root) or has_cameras(root / "test"))


def _job(root: Path, inputs: Inputs, config: CalibrateConfig) -> Job:
    photos = photos_of(root)
    if len(photos) < 2:
        raise CaptureError(
            f"{root}: holds {len(photos)} photo; cameras need at least 2 that overlap, better 20 or more all around"
        )
    refine = config.mode == "refine"
    if refine and sum(photo.pose is not None for photo in photos) < 2:
        raise CaptureError(f"{root}: calibrate.mode is refine, but the capture states no cameras; set it to auto")
    keep = config.intrinsics == "given" or (config.intrinsics == "auto" and config.mode != "anew")
    kept = tuple(photo for photo in photos if photo.pose is not None) if refine else photos
    work = kept_folder(inputs.out, f"calibrate {SCHEMA}").resolve()
    return Job(
        photos=without_cameras(kept, keep),
        config=config.model_dump(mode="json"),
        refine=refine,
        seed=inputs.seed,
        threads=numba.get_num_threads(),
        work=str(work),
        result=str(work / "result"),
    )


def _decision(job: Job) -> dict[str, str]:
    if job.refine:
        return {"decision": "refined", "reason": "calibrate.mode is refine"}
    if job.config["mode"] == "anew":
        return {"decision": "found", "reason": "calibrate.mode is anew"}
    known = any(photo.pose is not None for photo in job.photos)
    return {"decision": "found", "reason": f"{'part of the capture' if known else 'the capture'} has no cameras"}


def _check(document: Calibration, config: CalibrateConfig, root: Path) -> None:
    """Stop when too many photos are left out or stand on weak feet; the first finding says what to shoot."""
    sound = sum(photo.registered and photo.points >= WEAK for photo in document.photos)
    given = len(document.photos)
    if sound >= max(2, config.min_registered * given):
        return
    first = next((each for each in document.findings if each.severity == "warning"), None)
    advice = f": {first.file} {first.text}; {first.remedy}" if first else ""
    raise CaptureError(
        f"{root}: only {sound} of {given} photos could be calibrated, expected at "
        f"least {config.min_registered:.0%} (calibrate.min_registered){advice}"
    )


STAGE = Stage(
    name="calibrate",
    summary="Find the cameras of photos that come without.",
    inputs=Inputs,
    outputs=Outputs,
    config=CalibrateConfig,
    run=run,
    example="ibrpipe calibrate captures/vase --out runs/vase",
)
