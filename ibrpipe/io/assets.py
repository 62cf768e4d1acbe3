"""Asset folders: `asset.json`, and per texture a deep OpenEXR of layers and, where modelled, view-dependent parts.

View dependence is a list of components, so that further kinds can join without a new schema: a reader that meets a kind
it does not know says which, instead of rendering something else.
"""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from ibrpipe.errors import FormatError, MissingFileError, ResourceError
from ibrpipe.io.layers import read_layers, write_layers
from ibrpipe.io.residuals import read_residuals, write_residuals
from ibrpipe.types import Asset, SpiralTexture
from ibrpipe.version import VERSION

SCHEMA = 1
INDEX = "asset.json"


class Component(BaseModel):
    """One way in which a texture's colour depends on the view."""

    model_config = ConfigDict(extra="allow")

    kind: str = Field(description="spiral: residual images on spiral directions; more kinds may join")
    file: str = Field(description="Path below the asset folder")


class TextureEntry(BaseModel):
    """One texture of an asset."""

    name: str = Field(description="Name of the support rectangle")
    layers: str = Field(description="Path of the deep OpenEXR below the asset folder")
    components: list[Component] = Field(default_factory=list, description="View dependence; empty = diffuse only")
    measured: dict[str, Any] = Field(default_factory=dict, description="Measured figures and errors of this texture")


class AssetIndex(BaseModel):
    """The content of ``asset.json``."""

    schema_version: Literal[1] = Field(1, description="Version of this layout")
    generator: str = Field(f"ibrpipe {VERSION}", description="What wrote the asset")
    units: str = Field("scene units of the capture", description="Length unit of all positions and depths")
    axes: str = Field("world axes of the capture, right-handed", description="Frame of all positions")
    color_space: str = Field("lin_rec709_scene", description="Colour space of the layers")
    textures: list[TextureEntry] = Field(description="All textures; they share one world")
    provenance: dict[str, Any] = Field(default_factory=dict, description="Photos, settings and versions behind it")


def write_asset(asset: Asset, path: str | Path, quality: int = 100) -> None:
    """Write an asset folder; an existing asset there is replaced once the new one is complete.

    Parameters
    ----------
    asset : Asset
    path : path
        Folder.
    quality : int
        WebP quality of 8-bit residuals; 100 is lossless.

    Raises
    ------
    ResourceError
        The folder cannot be written.
    """
    folder = Path(path)
    draft = folder.with_name(f".{folder.name}.partial")
    try:
        shutil.rmtree(draft, ignore_errors=True)
        entries = [_write_texture(texture, draft, i, quality) for i, texture in enumerate(asset.textures)]
        known = {key: value for key, value in asset.info.items() if key not in ("textures", "schema_version")}
        named = asset.info.get("textures", [])
        for entry, before in zip(entries, named, strict=False):
            entry.name, entry.measured = before.get("name", entry.name), before.get("measured", {})
        write_index(AssetIndex(textures=entries, **known), draft)
        if folder.exists():
            shutil.rmtree(folder)
        draft.rename(folder)
    except OSError as error:
        if isinstance(error, ResourceError):
            raise
        raise ResourceError(f"{folder}: cannot write the asset: {error.strerror or error}") from error


def _write_texture(texture: SpiralTexture, draft: Path, index: int, quality: int) -> TextureEntry:
    folder = draft / f"texture_{index:02d}"
    folder.mkdir(parents=True)
    write_layers(texture.layers, folder / "layers.exr")
    components = []
    if texture.residuals is not None:
        file = write_residuals(texture.residuals, folder, quality)
        components.append(Component(kind="spiral", file=f"{folder.name}/{file.name}"))
    return TextureEntry(name=folder.name, layers=f"{folder.name}/layers.exr", components=components)


def write_index(index: AssetIndex, folder: Path) -> None:
    """Write ``asset.json`` into an existing folder."""
    (folder / INDEX).write_text(index.model_dump_json(indent=1), encoding="utf-8")


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
        data = json.loads(file.read_text(encoding="utf-8"))
        version = data.get("schema_version") if isinstance(data, dict) else None
        if version != SCHEMA:
            raise FormatError(
                f"{file}: asset of schema version {version}; this program reads version {SCHEMA}: use a newer ibrpipe"
            )
        return AssetIndex.model_validate(data)
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise FormatError(f"{file}: not JSON ({error}); copy the asset again") from error
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"])
        raise FormatError(f"{file}: {where}: {first['msg']}; copy the asset again") from error


def read_asset(path: str | Path) -> Asset:
    """Read an asset folder.

    Raises
    ------
    MissingFileError, FormatError
        A file is missing or damaged, or a component's kind is unknown.
    """
    index = read_index(path)
    textures = tuple(_read_texture(Path(path), entry) for entry in index.textures)
    return Asset(textures, index.model_dump())


def _read_texture(folder: Path, entry: TextureEntry) -> SpiralTexture:
    residuals = None
    for component in entry.components:
        if component.kind != "spiral" or residuals is not None:
            raise FormatError(
                f"{folder / INDEX}: texture {entry.name} has a component of kind {component.kind!r} that this program "
                "cannot render; use a newer ibrpipe"
            )
        residuals = read_residuals(folder / component.file)
    return SpiralTexture(read_layers(folder / entry.layers), residuals)
