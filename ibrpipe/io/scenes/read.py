"""Reads a scene of either form."""

from __future__ import annotations

from pathlib import Path

from ibrpipe.errors import ConfigError, FormatError, MissingFileError
from ibrpipe.io.scenes.folder import NAME, read_folder
from ibrpipe.io.scenes.gltf import read_gltf
from ibrpipe.io.untrusted.boundary import reader
from ibrpipe.types import Scene

_GLTF, _YAML = (".glb", ".gltf"), (".yaml", ".yml")


def is_scene(path: Path) -> bool:
    """Say whether there is a scene folder, its YAML file or a glTF file at `path`."""
    return (path / NAME).is_file() or (path.is_file() and path.suffix.lower() in (*_GLTF, *_YAML))


@reader("mend the scene")
def read_scene(path: str | Path) -> Scene:
    """Read a scene.

    Parameters
    ----------
    path : path
        A folder that holds ``scene.yaml``, such a file, or a .glb or .gltf file.

    Returns
    -------
    Scene
        Of a glTF file: meshes that several nodes share, and copies of EXT_mesh_gpu_instancing, are one part; nodes with
        children are parts, equal ones a single part. Textures give colours at vertices.

    Raises
    ------
    MissingFileError
        It, or a file that it names, does not exist.
    ConfigError, FormatError
        It cannot be used; the message names file, place and remedy.
    """
    return _read(Path(path), ())


def _read(path: Path, within: tuple[Path, ...]) -> Scene:
    """Read a scene that stands in those of the files `within`."""
    if path.suffix.lower() in _GLTF:
        return read_gltf(path)
    file = path / NAME if path.is_dir() else path
    if not file.is_file():
        raise MissingFileError(f"{file}: there is no such scene; give a folder with {NAME}, or a .glb or .gltf file")
    if file.suffix.lower() not in _YAML:
        raise FormatError(f"{file}: is no scene; expected {NAME} or a .glb or .gltf file")
    if file.resolve() in within:
        raise ConfigError(f"the scene {file} holds itself, through parts that are scenes; a scene has no cycles")
    return read_folder(file, lambda inner: _read(inner, (*within, file.resolve())))
