"""Stage ingest: a capture folder in, checked views out, with a clean mesh and sparse points where there are any.

Everything that can be wrong with a capture is looked for here, before anything expensive runs.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from pydantic import Field

from ibrpipe.capture.audit import audit_capture, stop_on_errors, terminal_summary, write_audit
from ibrpipe.capture.findings import Limits
from ibrpipe.config import StageConfig
from ibrpipe.engine.stage import Stage, StageOutputs, artifact
from ibrpipe.errors import CaptureError, FormatError
from ibrpipe.io.cameras.lenses import Keep
from ibrpipe.io.cameras.shots import photo_root
from ibrpipe.io.captures import Capture, CaptureOptions, Exposure, Orientation, read_capture
from ibrpipe.io.documents.audit import Audit
from ibrpipe.io.documents.calibration import Calibration
from ibrpipe.io.documents.views import Views
from ibrpipe.io.points import points_of_views, write_points
from ibrpipe.io.surfaces.meshes import read_surface, write_mesh
from ibrpipe.io.views import View, ViewSet, shrink_view, write_views
from ibrpipe.types import Mesh


class IngestConfig(StageConfig):
    """Settings of the ingest stage."""

    hold_out_every: int = Field(
        8, ge=0, le=1000, description="Without a test/ folder, every n-th photo is kept for measuring; 0 = none"
    )
    exposure: Exposure = Field(
        "auto", description="Where exposure gains come from: csv, exif, none, or auto (csv, else exif, else none)"
    )
    orientation: Orientation = Field(
        "auto", description="Orientation tags: apply, ignore, or auto (obeyed only where the camera's size asks for it)"
    )
    undistort: Keep = Field(
        "all", description="What undistortion keeps: all pixels (empty margins masked) or the inside without margins"
    )
    color_space: str | None = Field(
        None, description="Colour space of all photos, such as srgb_rec709_scene; none = as each file declares"
    )
    allow_outside: bool = Field(
        False,
        description="What a capture consists of may lie outside its folder, where links or paths lead",
    )
    max_pixels: int | None = Field(
        None, ge=64, description="Photos with more pixels are shrunk to at most this many on loading; none = never"
    )
    video_frames: int = Field(
        120, ge=2, le=5000, description="Where a capture is a video or holds some: photos to take from them, at most"
    )
    use_every: int = Field(
        1, ge=1, le=1000, description="Make the asset from every n-th photo only, by name; held-out photos stay"
    )
    mask_threshold: float | None = Field(
        None,
        gt=0,
        lt=1,
        description="Photos without a mask: what is brighter than this (display code, 0..1) is the object; none = all",
    )
    blur_deviations: float = Field(
        3.5,
        gt=0,
        le=100,
        description="A photo is called blurred when it is this many robust deviations below the median",
    )
    clipped_share: float = Field(
        0.05, ge=0, le=1, description="Share of clipped pixels inside the mask from which on a photo is warned about"
    )
    thin_share: float = Field(
        0.05,
        ge=0,
        le=1,
        description="Share of the surface seen by fewer than 3 photos from which on a warning is given",
    )


@dataclass(frozen=True)
class Inputs:
    """A capture folder, the folder to write to, and what the calibrate stage has found."""

    capture: Path
    out: Path
    calibration: Path | None = None


@dataclass(frozen=True)
class Outputs(StageOutputs):
    """What ingest writes."""

    views: Path = artifact("views.json", "views.json of the ingest stage.", Views)
    audit: Path = artifact("audit.json", "audit.json of the ingest stage.", Audit)
    audit_text: Path = artifact("audit.txt", "The audit in words.")
    given: Path | None = artifact("mesh.ply", "The capture's own mesh (PLY).", optional=True)
    points: Path | None = artifact("points.npz", "Sparse points of the calibration (NPZ).", optional=True)


def run(inputs: Inputs, config: IngestConfig) -> Outputs:
    """Check a capture; write ``views.json``, ``audit.*``, ``summary.txt``; ``mesh.ply`` and ``points.npz`` if any.

    Raises
    ------
    MissingFileError, FormatError, CaptureError
        The capture cannot be used; the message says why and what to do.
    """
    options = CaptureOptions(
        config.hold_out_every,
        config.exposure,
        config.orientation,
        config.undistort,
        config.color_space,
        inputs.calibration,
        config.allow_outside,
    )
    capture = _reduced(_shrunk(read_capture(inputs.capture, options), config.max_pixels), config)
    capture = _without_foreign_mesh(capture, inputs.calibration)
    mesh = _mesh(capture)
    audit = audit_capture(capture, mesh, _limits(config))
    stop_on_errors(audit)
    inputs.out.mkdir(parents=True, exist_ok=True)
    outputs = Outputs.below(inputs.out)
    surface = None if mesh is None else outputs.given
    if mesh is not None and surface is not None:
        write_mesh(mesh, surface)
    points = None if capture.model is None else points_of_views(capture.model, photo_root(capture.root), capture.train)
    if points is not None and outputs.points is not None:
        write_points(points, outputs.points)
    write_views(_view_set(capture, surface), outputs.views)
    write_audit(audit, capture, outputs.audit, outputs.audit_text)
    (inputs.out / "summary.txt").write_text(terminal_summary(audit, capture), encoding="utf-8")
    return outputs.made()


def _without_foreign_mesh(capture: Capture, calibration: Path | None) -> Capture:
    """Leave a mesh out that lies in another world than the cameras which the calibrate stage has found."""
    known = Calibration.of_folder(calibration)
    if capture.mesh is None or known is None or not known.in_own_world:
        return capture
    note = f"{capture.mesh.name} is left out: the cameras were found from the photos alone, in a world of their own"
    return replace(capture, mesh=None, notes=(*capture.notes, note))


def _mesh(capture: Capture) -> Mesh | None:
    if capture.mesh is None:
        return None
    try:
        return read_surface(capture.mesh)
    except FormatError as error:
        raise CaptureError(str(error)) from error


def _limits(config: IngestConfig) -> Limits:
    return Limits(blurred=config.blur_deviations, clipped=config.clipped_share, thin=config.thin_share)


def _shrunk(capture: Capture, max_pixels: int | None) -> Capture:
    train = tuple(shrink_view(view, max_pixels) for view in capture.train)
    return replace(capture, train=train, test=tuple(shrink_view(view, max_pixels) for view in capture.test))


def _reduced(capture: Capture, config: IngestConfig) -> Capture:
    """Leave photos out and mask by brightness, as asked for."""
    train, test = capture.train[:: config.use_every], capture.test
    if config.mask_threshold is not None:
        train, test = (_masked(group, config.mask_threshold) for group in (train, test))
    return replace(capture, train=train, test=test)


def _masked(views: tuple[View, ...], threshold: float) -> tuple[View, ...]:
    return tuple(view if view.masked else replace(view, mask_threshold=threshold) for view in views)


def _view_set(capture: Capture, mesh: Path | None) -> ViewSet:
    notes = [*capture.warnings, *capture.notes]
    info = {"capture": str(capture.root), "exposure": capture.exposure, "notes": notes}
    return ViewSet(capture.train, capture.test, mesh, info)


STAGE = Stage(
    name="ingest",
    summary="Check a capture folder and turn its photos and cameras into views that every later stage reads.",
    inputs=Inputs,
    outputs=Outputs,
    config=IngestConfig,
    run=run,
    example="ibrpipe ingest captures/shiny_vase --out runs/vase",
)
