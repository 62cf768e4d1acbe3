"""Write an asset folder in another coding, and say what every texture lost by it."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from ibrpipe.core.color import srgb_encode
from ibrpipe.errors import ConfigError, MissingFileError
from ibrpipe.io.assets import AssetIndex, TextureEntry, schema_of, write_coded, write_component, write_index
from ibrpipe.io.components import Component, ComponentFiles, SampleFiles, SharedFiles, find_kind
from ibrpipe.io.documents.texture_errors import TextureErrors
from ibrpipe.io.layer_pictures import Coding
from ibrpipe.io.layer_pictures.avif import QUICK, THOROUGH
from ibrpipe.types import Asset, LayeredDepthImage, ViewDependence
from ibrpipe.types.view_dependence import SharedData


def recode(
    source: Path,
    index: AssetIndex,
    asset: Asset,
    out: Path,
    coding: Coding | None,
    quality_of: Callable[[str], int | None] = lambda kind: None,
    speed: int = THOROUGH,
) -> AssetIndex:
    """Write the asset in folder `source`, which was read as `index` and `asset`, into the folder `out`.

    Parameters
    ----------
    coding : Coding or None
        Of the layers; None = deep OpenEXR.
    quality_of : function
        Of a kind of view dependence, 1 to 99; None, or where that is no smaller: its files are kept.
    speed : int
        As `ibrpipe.io.layer_pictures.avif.encode_avif` takes it.

    Returns
    -------
    AssetIndex
        What ``asset.json`` says: as before, with the new files. It is written by `finish`.
    """

    def texture(number: int) -> TextureEntry:
        entry, own = index.textures[number], asset.textures[number]
        folder = out / f"texture_{number:02d}"
        folder.mkdir(parents=True, exist_ok=True)
        file = write_coded(own.layers, folder, coding, speed)
        components = [
            _recoded(source, told, part, own.layers, folder, quality_of(part.kind), speed)
            for told, part in zip(entry.components, own.components, strict=True)
        ]
        changed = {"layers": f"{folder.name}/{file.name}", "coding": coding, "components": components}
        return entry.model_copy(update=changed)

    with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
        entries = list(pool.map(texture, range(len(index.textures))))
    shared = [_shared(source, told, asset, out, quality_of(told.kind), speed) for told in index.shared]
    return index.model_copy(update={"textures": entries, "shared": shared, "schema_version": schema_of(entries)})


def _shared(source: Path, told: Component, asset: Asset, out: Path, quality: int | None, speed: int) -> Component:
    """Write what components share at a quality if their kind can and that saves bytes."""
    data, files = asset.shared.get(told.kind), shared_files(told.kind)
    if quality is not None and files is not None and data is not None:
        fresh = Component(kind=told.kind, **files.recode_shared(data, out, quality, speed))
        if _bytes(out, fresh) < _bytes(source, told):
            return fresh
        for path in fresh.paths:
            (out / path).unlink()
    _copy(source, told, out)
    return told


def shared_files(kind: str) -> SharedFiles | None:
    """Return how a kind's shared data is coded anew; None = it is kept as it is."""
    files = find_kind(kind).part("files", ComponentFiles)
    return files if isinstance(files, SharedFiles) else None


def shared_through_files(data: SharedData, kind: str, folder: Path, quality: int) -> tuple[SharedData, int]:
    """Return what components share as it comes back from the (new) `folder` at a quality, and its bytes."""
    folder.mkdir(parents=True)
    files = shared_files(kind)
    if files is None:
        raise ConfigError(f"what view dependence of kind {kind!r} shares cannot be coded anew")
    fresh = Component(kind=kind, **files.recode_shared(data, folder, quality, QUICK))
    return files.read_shared(fresh, folder), _bytes(folder, fresh)


def _recoded(
    source: Path,
    told: Component,
    part: ViewDependence,
    layers: LayeredDepthImage,
    folder: Path,
    quality: int | None,
    speed: int,
) -> Component:
    """Write a component at a quality if that saves bytes; what only refers to shared data stays as it is."""
    if quality is not None and holds_own(part):
        fresh = write_component(part, folder, quality, layers, speed).below(folder.name)
        if _bytes(folder.parent, fresh) < _bytes(source, told):
            return fresh
        for path in fresh.paths:
            (folder.parent / path).unlink()
    _copy(source, told, folder.parent)
    return told


def holds_own(part: ViewDependence) -> bool:
    """Say whether a component can be written anew without what it shares with others."""
    return part.shared is None or isinstance(find_kind(part.kind).part("files", object), SampleFiles)


def through_files(
    part: ViewDependence, layers: LayeredDepthImage, folder: Path, quality: int
) -> tuple[ViewDependence, int]:
    """Return a component as it comes back from the (new) `folder` at a quality, and its bytes."""
    folder.mkdir(parents=True)
    files, fresh = find_kind(part.kind).part("files", ComponentFiles), write_component(part, folder, quality, layers)
    size = _bytes(folder, fresh)
    if isinstance(files, SampleFiles):
        return files.read_on(fresh, folder, part.shared, layers), size
    return files.read(fresh, folder, part.shared), size


def _copy(source: Path, told: Component, out: Path) -> None:
    for path in told.paths:
        if not (source / path).is_file():
            raise MissingFileError(f"{source / path}: no such file; copy the asset again")
        (out / path).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(source / path, out / path)


def _bytes(folder: Path, told: Component) -> int:
    return sum((folder / path).stat().st_size for path in told.paths)


def finish(
    index: AssetIndex,
    out: Path,
    losses: Sequence[dict[str, Any] | None],
    provenance: dict[str, Any] | None = None,
    errors: Sequence[TextureErrors] = (),
) -> None:
    """Write ``asset.json`` with what every texture lost, and what is known of the coding of the whole.

    Parameters
    ----------
    losses : a dict per texture, told as ``measured.coding``; None = left out
    errors : one per texture, told as ``measured.error``
    provenance : dict, optional
        Told as ``provenance.compression``.
    """
    textures = [
        entry.model_copy(update={"measured": entry.measured | ({} if lost is None else {"coding": lost})})
        for entry, lost in zip(index.textures, losses, strict=True)
    ]
    for entry, error in zip(textures, errors, strict=False):
        entry.measured["error"] = error.model_dump(exclude_none=True)
    more = {} if provenance is None else {"compression": provenance}
    write_index(index.model_copy(update={"textures": textures, "provenance": {**index.provenance, **more}}), out, None)


def losses(before: LayeredDepthImage, after: LayeredDepthImage) -> dict[str, float | None]:
    """Return what the coding of a texture's layers lost.

    Returns
    -------
    dict
        ``color_psnr`` in display code, dB, None = nothing lost; ``depth_error_rms`` and ``depth_error_max``, scene
        units; ``normal_error_mean``, degrees.
    """
    color = srgb_encode(after.color).astype(np.float64) - srgb_encode(before.color)
    error = float((color**2).mean()) if color.size else 0.0
    depth = np.abs(after.depth.astype(np.float64) - before.depth)
    return {
        "color_psnr": round(-10.0 * float(np.log10(error)), 2) if error else None,
        "depth_error_rms": float(f"{np.sqrt((depth**2).mean()) if len(depth) else 0.0:.3g}"),
        "depth_error_max": float(f"{depth.max(initial=0.0):.3g}"),
        "normal_error_mean": _angle(before.normal, after.normal),
    }


def _angle(before: Any, after: Any) -> float | None:
    """Return the mean angle between normals that are known, degrees."""
    one, other = before.astype(np.float64), after.astype(np.float64)
    sizes = np.linalg.norm(one, axis=1) * np.linalg.norm(other, axis=1)
    known = np.isfinite(sizes) & (sizes > 0)
    if not known.any():
        return None
    across = np.linalg.norm(np.cross(one[known], other[known]), axis=1)
    turned = np.degrees(np.arctan2(across, (one[known] * other[known]).sum(axis=1)))
    return float(f"{turned.mean():.3g}")


def texture_bytes(entry: TextureEntry, folder: Path) -> int:
    """Return the bytes on disk of a texture: its layers and components."""
    files = [entry.layers, *(path for part in entry.components for path in part.paths)]
    return sum((folder / file).stat().st_size for file in files if (folder / file).is_file())
