"""Scene folders: ``scene.yaml`` and the meshes, matrices, assets and reliefs that it names."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path, PureWindowsPath

import numpy as np

from ibrpipe.errors import ConfigError, FormatError, IbrError, MissingFileError, closest
from ibrpipe.io.assets import read_captured
from ibrpipe.io.documents.scene import Copies, Placement, Relief, SceneDocument, SceneLighting, ScenePart
from ibrpipe.io.scenes.painted import read_painted
from ibrpipe.io.scenes.placement import placement_matrix, read_matrices, singular
from ibrpipe.io.surfaces.materials import read_relief_meshes
from ibrpipe.io.surfaces.relief_images import read_relief_folder
from ibrpipe.io.untrusted.inside import leads_inside
from ibrpipe.io.yaml_settings import Key, Settings, parse, validated
from ibrpipe.types import Array, Instances, Light, Lighting, PaintedMesh, Part, ReliefTexture, Scene
from ibrpipe.types.camera import ParallelFrame
from ibrpipe.types.renderable import Captured

#: the document of a scene folder
NAME = "scene.yaml"

_log = logging.getLogger(__name__)


def read_document(file: Path) -> tuple[SceneDocument, Settings]:
    """Read ``scene.yaml`` alone: what it says, and in which lines.

    Raises
    ------
    ConfigError
        It is no YAML, or says something that no scene has.
    """
    try:
        settings = parse(file.read_text(encoding="utf-8"), str(file))
    except UnicodeDecodeError as error:
        raise ConfigError(f"{file}: not UTF-8 ({error.reason}); save it again as UTF-8") from error
    return validated(SceneDocument, settings), settings


def read_folder(file: Path, read_inner: Callable[[Path], Scene]) -> Scene:
    """Read the scene of a ``scene.yaml``; `read_inner` reads the scenes that it names."""
    return _Reader(file, read_inner).scene()


class _Reader:
    """One file on its way to a scene."""

    def __init__(self, file: Path, read_inner: Callable[[Path], Scene]) -> None:
        self._file, self._read_inner = file, read_inner
        self._document, self._settings = read_document(file)

    def scene(self) -> Scene:
        """Return it."""
        parts: list[Part] = []
        for name, entry in self._document.parts.items():
            parts += self._parts(name, entry)
        with self._at(("lighting",)):
            lighting = _lighting(self._document.lighting)
        with self._at(("root",)):
            return Scene(parts, self._document.root, lighting)

    def _parts(self, name: str, entry: ScenePart) -> Iterator[Part]:
        """Read one part, and those of the scene that it may be."""
        key: Key = ("parts", name)
        children = [self._copies(each, (*key, "children", n)) for n, each in enumerate(entry.children)]
        if entry.scene is not None:
            with self._at((*key, "scene")):
                inner = self._read_inner(self._path(entry.scene, (*key, "scene")))
            for part in inner.parts.values():
                moved = tuple(Instances(f"{name}.{each.part}", each.matrices) for each in part.children)
                yield Part(f"{name}.{part.name}", part.meshes, part.sources, moved)
            children.insert(0, Instances(f"{name}.{inner.root}", np.eye(4)))
        meshes: list[PaintedMesh] = []
        for n, mesh in enumerate(entry.meshes):
            at: Key = (*key, "meshes", n)
            with self._at(at):
                meshes += read_painted(self._path(mesh.file, at), mesh.color, mesh.specular, mesh.shininess)
        with self._at(key):
            yield Part(name, tuple(meshes), tuple(self._sources(entry, key)), tuple(children))

    def _sources(self, entry: ScenePart, key: Key) -> Iterator[Captured]:
        for n, folder in enumerate(entry.assets):
            at: Key = (*key, "assets", n)
            with self._at(at):
                yield from read_captured(self._path(folder, at))
        for n, relief in enumerate(entry.reliefs):
            at = (*key, "reliefs", n)
            with self._at(at):
                yield _relief(relief, self._path(relief.folder, at))
        for n, mapping in enumerate(entry.relief_meshes):
            at = (*key, "relief_meshes", n)
            with self._at(at):
                images = None if mapping.relief is None else self._path(mapping.relief, at)
                options = {"thickness": mapping.thickness, "repeat": tuple(mapping.repeat)}
                yield from read_relief_meshes(self._path(mapping.file, at), images, **options)

    def _copies(self, entry: Copies, key: Key) -> Instances:
        if entry.part not in self._document.parts:
            place = self._settings.place((*key, "part"))
            raise ConfigError(f"{place}: there is no part {entry.part!r}; {closest(entry.part, self._document.parts)}")
        with self._at(key):
            if entry.matrices is not None:
                matrices = read_matrices(self._path(entry.matrices, (*key, "matrices")))
            else:
                placed = [Placement()] if entry.at is None else entry.at
                matrices = np.array([placement_matrix(each) for each in placed]).reshape(-1, 4, 4)
            found = Instances(entry.part, matrices)
        self._tell_singular(found, key)
        return found

    def _tell_singular(self, copies: Instances, key: Key) -> None:
        flat = singular(copies.matrices)
        if flat.any():
            _log.warning(
                "%s: %d of %d copies of %s are flattened by singular matrices (the first is number %d); a scale of 0?",
                self._settings.place(key), flat.sum(), len(flat), copies.part, flat.argmax(),
            )  # fmt: skip

    def _path(self, name: str | None, key: Key) -> Path:
        """Return the place of a file in the scene's folder."""
        given, folder = PureWindowsPath(name or ""), self._file.parent
        led_out = given.drive or given.root or ".." in given.parts or not name
        if led_out or not leads_inside(folder, folder / str(name)):
            place = self._settings.place(key)
            raise ConfigError(f"{place}: {name!r} leads out of the scene's folder; put what it names there")
        return folder / str(name)

    @contextmanager
    def _at(self, key: Key) -> Iterator[None]:
        """Tell what is wrong inside with the line that asks for it."""
        try:
            yield
        except IbrError as error:
            if str(error).startswith(f"{self._file}:"):
                raise
            kind = type(error) if isinstance(error, (MissingFileError, FormatError)) else ConfigError
            raise kind(f"{self._settings.place(key)}: {error}") from error


def _relief(entry: Relief, folder: Path) -> ReliefTexture:
    low_high = None if entry.depth_range is None else (entry.depth_range[0], entry.depth_range[1])
    found = read_relief_folder(folder, low_high)
    if found.color is None:
        raise FormatError(f"{folder}: holds no colours; put color.png beside the height map")
    if entry.frame is not None:
        frame = ParallelFrame(*(np.array(getattr(entry.frame, name)) for name in ("origin", "a", "b", "f")))
        return ReliefTexture(frame, found.color, found.height)
    (width, tall), (rows, columns) = entry.size or (1.0, 1.0), found.height.shape
    steps = np.diag([width / columns, -tall / rows, 1.0])
    return ReliefTexture(ParallelFrame(np.array([-0.5 * width, 0.5 * tall, 0.0]), *steps), found.color, found.height)


def _lighting(entry: SceneLighting | None) -> Lighting | None:
    if entry is None:
        return None
    lights = tuple(Light(np.array(each.direction), np.array(each.color)) for each in entry.lights)
    return Lighting(np.array(entry.ambient), lights)


def matrix_rows(matrix: Array) -> list[list[float]]:
    """Return a (4, 4) affine matrix as ``scene.yaml`` holds it."""
    rows: list[list[float]] = matrix[:3].tolist()
    return rows
