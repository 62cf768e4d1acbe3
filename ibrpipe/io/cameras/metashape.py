"""Agisoft Metashape's ``cameras.xml`` (File > Export > Export Cameras) as lenses and poses.

A camera's transform is world-from-camera with x right, y down, z forward, in the axes of its component; the component's
(or chunk's) own transform, rotation, translation and scale, leads to the local coordinates in which Metashape exports
its models. Cameras of a rig but the master have none: their sensor states place and rotation in the master's axes.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from ibrpipe.core.similarity import move_poses
from ibrpipe.errors import CaptureError, FormatError
from ibrpipe.io.cameras.metashape_lens import numbers_of, sensor_lens
from ibrpipe.io.cameras.shots import CameraSet, PhotoFolder, Shot, name_below, refuse_missing
from ibrpipe.io.untrusted.boundary import reader
from ibrpipe.types import Array

METASHAPE = "cameras.xml"
#: scale, rotation and translation from the axes of a component to local coordinates
_Similarity = tuple[float, Array, Array]


@dataclass(eq=False)
class _Left:
    """Cameras that are not read, by the reason."""

    labels: dict[str, list[str]] = field(default_factory=dict)

    def add(self, reason: str, label: str) -> None:
        self.labels.setdefault(reason, []).append(label)

    def told(self, path: Path, total: int) -> tuple[str, ...]:
        return tuple(
            f"{path.name}: {len(labels)} of {total} cameras {reason} and are left out, the first is {labels[0]}"
            for reason, labels in self.labels.items()
        )


@reader("export the cameras from Metashape again")
def read_metashape(path: Path, images: Path) -> CameraSet:
    """Read the aligned cameras of a chunk, that of most of them where there are several.

    Parameters
    ----------
    path : Path
    images : Path
        Folder of the photos; labels count with or without suffix, groups and sensors called as a sub-folder tell photos
        of the same name apart.

    Returns
    -------
    CameraSet
        Cameras of a rig are placed by their master; those that are not aligned, switched off, or of a component whose
        place is not known are left out and counted.

    Raises
    ------
    FormatError, CaptureError
        Not such a file, a kind of lens that is not supported, no aligned camera.
    """
    chunks = _chunks(path)
    chunk = max(chunks, key=lambda each: sum(camera.find("transform") is not None for camera in each.iter("camera")))
    cameras = list(_cameras(chunk))
    sensors = {sensor.get("id"): sensor for sensor in chunk.iter("sensor")}
    worlds, left, photos = _Worlds(path, chunk, [camera for camera, _ in cameras]), _Left(), PhotoFolder(images)
    missing: list[str] = []
    shots, placed = [], 0
    by_id = {camera.get("id"): camera for camera, _ in cameras}
    for camera, group in cameras:
        label, sensor = camera.get("label", ""), sensors.get(camera.get("sensor_id"))
        matrix, reason = _matrix(path, camera, by_id, sensor)
        world = worlds.of(by_id.get(camera.get("master_id"), camera))
        if camera.get("enabled", "1") in ("0", "false"):
            reason = "are switched off in Metashape"
        elif matrix is not None and world is None:
            reason = "belong to a component whose place among the others is not known"
        if reason or matrix is None or world is None:
            left.add(reason, label)
            continue
        near = (group, "" if sensor is None else sensor.get("label", ""))
        image = photos.find(label, path, near)
        if image is None:
            missing.append(label)
            continue
        shots.append(Shot(name_below(image, images), image, sensor_lens(path, sensor, label), _pose(matrix, world)))
        placed += camera.find("transform") is None
    refuse_missing(missing, len(cameras), path, images)
    if not shots:
        raise CaptureError(f"{path}: holds no aligned camera; align the photos in Metashape and export again")
    warnings = list(left.told(path, len(cameras)))
    if len(chunks) > 1:
        text = f"{path.name}: holds {len(chunks)} chunks; only that of most aligned cameras"
        warnings.append(f"{text}, {chunk.get('label') or 'without a label'}, is read")
    notes = (f"{path.name}: {placed} cameras of a rig are placed by their sensor's offset from the master",)
    if placed and abs(worlds.scale - 1.0) > 1e-3:
        text = f"its offset is taken in the chunk's own units, of which one is {worlds.scale:.4g} local units"
        warnings.append(
            f"{notes[0]}; {text}: if masks or mesh do not fit those cameras, export each with its transform"
        )
    shots.sort(key=lambda shot: shot.file)
    return CameraSet(tuple(shots), notes=notes if placed else (), warnings=tuple(warnings))


def _chunks(path: Path) -> list[ElementTree.Element]:
    try:
        chunks = ElementTree.parse(path).getroot().findall(".//chunk")
    except ElementTree.ParseError as error:
        raise FormatError(f"{path}: is not XML ({error}); export the cameras from Metashape again") from error
    if not chunks:
        raise FormatError(f"{path}: has no chunk; expected cameras exported from Metashape")
    return chunks


def _cameras(chunk: ElementTree.Element) -> list[tuple[ElementTree.Element, str]]:
    """All cameras of a chunk, each with the name of its group."""
    groups = {camera: group.get("label", "") for group in chunk.iter("group") for camera in group.iter("camera")}
    return [(camera, groups.get(camera, "")) for camera in chunk.iter("camera")]


def _matrix(
    path: Path,
    camera: ElementTree.Element,
    by_id: dict[str | None, ElementTree.Element],
    sensor: ElementTree.Element | None,
) -> tuple[Array | None, str]:
    """Where a camera stands, (4, 4) float64 component-from-camera, or None and why it is left out."""
    own, label = camera.find("transform"), camera.get("label", "")
    if own is not None:
        return _rigid(path, numbers_of(path, own, 16, label).reshape(4, 4), label), ""
    master = by_id.get(camera.get("master_id"))
    if master is None or master is camera:
        return None, "are not aligned"
    transform = master.find("transform")
    if transform is None:
        return None, "of a rig have a master that is not aligned"
    rotation, location = (None if sensor is None else sensor.find(name) for name in ("rotation", "location"))
    if rotation is None and location is None:
        return None, "of a rig have a sensor without an offset from the master"
    offset = np.eye(4)
    if rotation is not None:
        offset[:3, :3] = numbers_of(path, rotation, 9, label).reshape(3, 3)
    if location is not None:
        offset[:3, 3] = numbers_of(path, location, 3, label)
    of_master = _rigid(path, numbers_of(path, transform, 16, label).reshape(4, 4), master.get("label", ""))
    return of_master @ _rigid(path, offset, label), ""


def _rigid(path: Path, matrix: Array, label: str) -> Array:
    R = matrix[:3, :3]
    if not np.isfinite(matrix).all() or np.abs(R @ R.T - np.eye(3)).max() > 1e-3 or np.linalg.det(R) < 0:
        raise CaptureError(f"{path}: the transform of {label} is no rigid motion; export the cameras again")
    left, _, right = np.linalg.svd(R)
    return np.block([[left @ right, matrix[:3, 3:]], [np.zeros((1, 3)), np.ones((1, 1))]])


def _pose(matrix: Array, world: _Similarity) -> Array:
    R = matrix[:3, :3].T
    moved: Array = move_poses(world, np.concatenate([R, -(R @ matrix[:3, 3])[:, None]], axis=1)[None])[0]
    return moved


class _Worlds:
    """Where the components of a chunk lie."""

    def __init__(self, path: Path, chunk: ElementTree.Element, cameras: list[ElementTree.Element]) -> None:
        self._path = path
        self._chunk = self._similarity(chunk.find("transform"))
        components = chunk.findall("components/component")
        self._own = {each.get("id"): self._similarity(each.find("transform")) for each in components}
        self._by_partition = {
            number: each.get("id")
            for each in components
            for ids in each.iter("camera_ids")
            for number in (ids.text or "").split()
        }
        used = Counter(self._component(camera) for camera in cameras if camera.find("transform") is not None)
        holder = chunk.find("components")
        active = None if holder is None else holder.get("active_id")
        self._main = active if active in used else max(used, key=lambda key: used[key], default=None)
        known = [self._own.get(active), *self._own.values(), (1.0, np.eye(3), np.zeros(3))]
        self._others = self._chunk or next(each for each in known if each is not None)

    @property
    def scale(self) -> float:
        """Local units in one unit of the chunk or its main component."""
        return float((self._own.get(self._main) or self._others)[0])

    def of(self, camera: ElementTree.Element) -> _Similarity | None:
        """Return where a camera's component lies; None = not known, though others are."""
        key = self._component(camera)
        own = None if key is None else self._own[key]
        if own is not None:
            return own
        if key is None:
            return self._others
        return (self._chunk or (1.0, np.eye(3), np.zeros(3))) if key == self._main else None

    def _component(self, camera: ElementTree.Element) -> str | None:
        stated = camera.get("component_id") or self._by_partition.get(camera.get("id", ""))
        return stated if stated in self._own else None

    def _similarity(self, transform: ElementTree.Element | None) -> _Similarity | None:
        """Similarity from a component's or chunk's axes to local coordinates, None where none is stated."""
        if transform is None:
            return None
        rotation, shift, scale = (transform.find(name) for name in ("rotation", "translation", "scale"))
        return (
            1.0 if scale is None else float(numbers_of(self._path, scale, 1, "chunk")[0]),
            np.eye(3) if rotation is None else numbers_of(self._path, rotation, 9, "chunk").reshape(3, 3),
            np.zeros(3) if shift is None else numbers_of(self._path, shift, 3, "chunk"),
        )
