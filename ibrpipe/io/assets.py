"""Asset folders: `asset.json`, and per texture its layers and, where modelled, view-dependent parts.

View dependence is a list of components, so that further kinds can join without a new schema: a reader that meets a kind
it does not know says which, instead of rendering something else.
"""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, Literal

from pydantic import ConfigDict, Field, SerializerFunctionWrapHandler, ValidationError, model_serializer

from ibrpipe.compile_progress import compiling_told
from ibrpipe.config import Document
from ibrpipe.errors import ConfigError, FormatError, IbrError, MissingFileError, ResourceError, ValueRangeError
from ibrpipe.io.components import Component, ComponentFiles, SampleFiles, find_kind
from ibrpipe.io.layer_pictures import NAME as PICTURES
from ibrpipe.io.layer_pictures import Coding, read_layer_pictures, write_layer_pictures
from ibrpipe.io.layer_pictures.avif import QUICK
from ibrpipe.io.layers import read_layers, write_layers
from ibrpipe.io.own_files import listed_by_manifest, put_in_place, real_folder, recover
from ibrpipe.io.surfaces.reliefs import is_reliefs, read_reliefs, reliefs_as_asset
from ibrpipe.io.untrusted.boundary import reader, utf8_text
from ibrpipe.io.untrusted.inside import inside
from ibrpipe.types import Asset, LayeredDepthImage, ReliefTexture, Texture, ViewDependence
from ibrpipe.types.view_dependence import SharedData
from ibrpipe.version import VERSION

#: the versions that are read; the last one when a texture's layers are coded compactly, else the first
SCHEMAS = (1, 2)
INDEX = "asset.json"


class TextureEntry(Document):
    """One texture of an asset."""

    model_config = ConfigDict(extra="ignore")

    name: str = Field(description="Name of the support rectangle")
    layers: str = Field(description="Path of the layers below the asset folder")
    coding: Coding | None = Field(
        None, description="How the layers are coded compactly (layers.zip); absent = deep OpenEXR"
    )
    components: list[Component] = Field(default_factory=list, description="View dependence; empty = diffuse only")
    measured: dict[str, Any] = Field(default_factory=dict, description="Measured figures and errors of this texture")

    @model_serializer(mode="wrap")
    def _said(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Leave out `coding` of a deep OpenEXR."""
        return {key: value for key, value in handler(self).items() if key != "coding" or value is not None}


class AssetIndex(Document):
    """The content of ``asset.json``."""

    model_config = ConfigDict(extra="ignore")

    schema_version: Literal[1, 2] = Field(1, description="Version of this layout")
    generator: str = Field(f"ibrpipe {VERSION}", description="What wrote the asset")
    units: str = Field("scene units of the capture", description="Length unit of all positions and depths")
    axes: str = Field("world axes of the capture, right-handed", description="Frame of all positions")
    color_space: str = Field("lin_rec709_scene", description="Colour space of the layers")
    textures: list[TextureEntry] = Field(description="All textures; they share one world")
    shared: list[Component] = Field(
        default_factory=list, description="What the components of a kind share among all textures; absent = nothing"
    )
    provenance: dict[str, Any] = Field(default_factory=dict, description="Photos, settings and versions behind it")

    @model_serializer(mode="wrap")
    def _said(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Leave out `shared` where nothing is."""
        return {key: value for key, value in handler(self).items() if key != "shared" or value}


def write_asset(asset: Asset, path: str | Path, quality: int = 100, coding: Coding | None = None) -> None:
    """Write an asset folder; an existing asset there is replaced once the new one is complete, other files in it stay.

    Parameters
    ----------
    asset : Asset
    path : path
        Folder.
    quality : int
        WebP quality of 8-bit residuals; 100 is lossless.
    coding : Coding, optional
        Compact form of the layers; left out = deep OpenEXR.

    Raises
    ------
    ResourceError
        The folder cannot be written, or holds something that is no asset.
    """
    folder = real_folder(Path(path))
    if folder.is_dir() and any(folder.iterdir()) and not (folder / INDEX).is_file():
        raise ResourceError(f"{folder}: holds files but no asset; name another folder, or empty it")
    draft = folder.with_name(f".{folder.name}.partial")
    try:
        recover(folder, listed_files)
        shutil.rmtree(draft, ignore_errors=True)
        named = dict(enumerate(asset.info.get("textures", [])))
        entries = [
            _write_texture(texture, draft, i, quality, coding, named.get(i, {}))
            for i, texture in enumerate(asset.textures)
        ]
        shared = [_write_shared(kind, data, draft, quality) for kind, data in asset.shared.items()]
        own = ("textures", "shared", "schema_version")
        known = {key: value for key, value in asset.info.items() if key not in own}
        write_index(AssetIndex(schema_version=schema_of(entries), textures=entries, shared=shared, **known), draft)
        put_in_place(draft, folder, listed_files)
    except OSError as error:
        if isinstance(error, ResourceError):
            raise
        raise ResourceError(f"{folder}: cannot write the asset: {error.strerror or error}") from error


def schema_of(entries: Sequence[TextureEntry]) -> Literal[1, 2]:
    """Return the oldest schema version that can tell of such textures."""
    return 1 if all(entry.coding is None for entry in entries) else 2


def _write_texture(
    texture: Texture, draft: Path, index: int, quality: int, coding: Coding | None, before: Mapping[str, Any]
) -> TextureEntry:
    """Write one texture; `before` is what an index said of it that was read."""
    folder = draft / f"texture_{index:02d}"
    folder.mkdir(parents=True)
    file = write_coded(texture.layers, folder, coding)
    return TextureEntry(
        name=before.get("name", folder.name),
        layers=f"{folder.name}/{file.name}",
        coding=coding,
        components=[
            write_component(part, folder, quality, None if coding is None else texture.layers).below(folder.name)
            for part in texture.components
        ],
        measured=before.get("measured", {}),
    )


def write_coded(layers: LayeredDepthImage, folder: Path, coding: Coding | None, speed: int = QUICK) -> Path:
    """Write layers into the folder of their texture, compactly or as deep OpenEXR; return the file.

    Raises
    ------
    ResourceError
        It cannot be written.
    """
    if coding is None:
        write_layers(layers, folder / "layers.exr")
        return folder / "layers.exr"
    write_layer_pictures(layers, folder / PICTURES, coding, speed)
    return folder / PICTURES


def read_coded(entry: TextureEntry, folder: Path) -> LayeredDepthImage:
    """Read the layers of a texture of the asset in `folder`.

    Raises
    ------
    MissingFileError, FormatError
        The file is missing or damaged.
    """
    return (read_layers if entry.coding is None else read_layer_pictures)(folder / entry.layers)


def write_component(
    component: ViewDependence,
    folder: Path,
    quality: int = 100,
    layers: LayeredDepthImage | None = None,
    speed: int = QUICK,
) -> Component:
    """Write a component as its kind does; return its entry, with paths that begin at `folder`.

    Parameters
    ----------
    quality : int
        1 to 100; 100 is lossless.
    layers : LayeredDepthImage, optional
        Those of its texture: with them a kind that can may store it more compactly.
    speed : int
        As `ibrpipe.io.layer_pictures.avif.encode_avif` takes it.

    Raises
    ------
    ConfigError
        Its kind is not registered.
    ResourceError
        A file cannot be written.
    """
    files = _files(component.kind)
    if layers is not None and isinstance(files, SampleFiles):
        return Component(kind=component.kind, **files.write_on(component, layers, folder, quality, speed))
    return Component(kind=component.kind, **files.write(component, folder, quality))


def _write_shared(kind: str, data: SharedData, draft: Path, quality: int) -> Component:
    return Component(kind=kind, **_files(kind).write_shared(data, draft, quality))


def _files(kind: str) -> ComponentFiles:
    files: ComponentFiles = find_kind(kind).part("files", ComponentFiles)
    return files


def write_index(index: AssetIndex, folder: Path, indent: int | None = 1) -> None:
    """Write ``asset.json`` into an existing folder; without indentation it is a quarter smaller."""
    (folder / INDEX).write_text(index.model_dump_json(indent=indent), encoding="utf-8")


@reader("copy the asset again")
def read_index(path: str | Path) -> AssetIndex:
    """Read and check ``asset.json`` of an asset folder.

    Raises
    ------
    MissingFileError
        The folder has no ``asset.json``.
    FormatError
        It is damaged or of a schema version that this program does not know.
    """
    file = Path(path) / INDEX
    if not file.is_file():
        raise MissingFileError(f"{file}: no such file; an asset folder holds asset.json, give the folder that does")
    try:
        data = json.loads(utf8_text(file, "copy the asset again", "not JSON"))
        version = data.get("schema_version") if isinstance(data, dict) else None
        if version not in SCHEMAS:
            known = " and ".join(map(str, SCHEMAS))
            raise FormatError(
                f"{file}: asset of schema version {version}; this program reads versions {known}: use a newer ibrpipe"
            )
        return _inside(AssetIndex.model_validate(data), file)
    except json.JSONDecodeError as error:
        raise FormatError(f"{file}: not JSON ({error}); copy the asset again") from error
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"])
        raise FormatError(f"{file}: {where}: {first['msg']}; copy the asset again") from error


def files_of(index: AssetIndex) -> list[str]:
    """Return the paths of all files that an index names, below the asset folder."""
    parts = [*(part for texture in index.textures for part in texture.components), *index.shared]
    return [*(texture.layers for texture in index.textures), *(name for part in parts for name in part.paths)]


def listed_files(folder: Path) -> set[str]:
    """Return the files in an asset folder that its index, or the manifest of the stage that made it, lists."""
    try:
        return {INDEX, *files_of(read_index(folder)), *listed_by_manifest(folder)}
    except IbrError:
        return listed_by_manifest(folder)


def _inside(index: AssetIndex, file: Path) -> AssetIndex:
    """Return the index; a name that leads out of the asset's folder, be it by a link, is an error."""
    for name in files_of(index):
        inside(file.parent, name, file, "copy the asset again")
    return index


@reader("copy the asset again")
def read_asset(path: str | Path) -> Asset:
    """Read an asset folder, or one of relief textures as an asset of one layer each.

    Raises
    ------
    MissingFileError, FormatError
        A file is missing or damaged, or a component's kind is unknown.
    """
    if is_reliefs(path):
        return reliefs_as_asset(path)
    index, folder = read_index(path), Path(path)
    shared = _read_shared(index, folder)
    with compiling_told(), ThreadPoolExecutor(os.cpu_count() or 1) as pool:
        textures = tuple(pool.map(lambda entry: _read_texture(folder, entry, shared), index.textures))
    return Asset(textures, index.model_dump())


def read_captured(path: str | Path) -> tuple[Asset | ReliefTexture | Texture, ...]:
    """Read what a folder holds as renderers take it: an asset, or relief textures; raises as `read_asset`."""
    return read_reliefs(path) if is_reliefs(path) else (read_asset(path),)


def read_textures(path: str | Path, names: Sequence[str] | None = None) -> Iterator[Texture]:
    """Read the textures of an asset folder one after another, so that a renderer can begin before all are decoded.

    Parameters
    ----------
    path : path
        Folder.
    names : sequence of str, optional
        Textures to read, in that order; left out = all, in the order of the asset.

    Raises
    ------
    MissingFileError, FormatError
        A file is missing or damaged, or a component's kind is unknown.
    ValueRangeError
        The asset has no texture of such a name.
    """
    index, folder = read_index(path), Path(path)
    known = {entry.name: entry for entry in index.textures}
    unknown = [name for name in names or () if name not in known]
    if unknown:
        raise ValueRangeError(f"{folder}: no texture is called {unknown[0]!r}; there are {', '.join(known)}")
    shared = _read_shared(index, folder)
    chosen = index.textures if names is None else [known[name] for name in names]
    return (_read_texture(folder, entry, shared) for entry in chosen)


def _read_shared(index: AssetIndex, folder: Path) -> dict[str, SharedData]:
    return {entry.kind: _known_files(folder, "the asset", entry).read_shared(entry, folder) for entry in index.shared}


def _read_texture(folder: Path, entry: TextureEntry, shared: Mapping[str, SharedData]) -> Texture:
    files = [_known_files(folder, f"texture {entry.name}", part) for part in entry.components]
    layers = read_coded(entry, folder)
    components = [
        each.read_on(part, folder, shared.get(part.kind), layers)
        if isinstance(each, SampleFiles)
        else each.read(part, folder, shared.get(part.kind))
        for each, part in zip(files, entry.components, strict=True)
    ]
    try:
        return Texture(layers, tuple(components))
    except ValueRangeError as error:
        raise FormatError(f"{folder / INDEX}: texture {entry.name}: cannot render {error}") from error


def _known_files(folder: Path, whose: str, entry: Component) -> ComponentFiles:
    try:
        return _files(entry.kind)
    except ConfigError as error:
        raise FormatError(
            f"{folder / INDEX}: {whose} has a component of kind {entry.kind!r} that this program cannot render: {error}"
        ) from error


def bytes_by_kind(index: AssetIndex, folder: Path) -> dict[str, int]:
    """Return the bytes on disk of every kind of view dependence, all textures and what is shared."""
    found: dict[str, int] = {}
    for entry in [*(part for texture in index.textures for part in texture.components), *index.shared]:
        found[entry.kind] = found.get(entry.kind, 0) + component_bytes(entry, folder)
    return found


def component_bytes(entry: Component, folder: Path) -> int:
    """Return the bytes on disk of one component; files that are missing count nothing."""
    files = [folder / path for path in entry.paths]
    return sum(file.stat().st_size for file in files if file.is_file())
