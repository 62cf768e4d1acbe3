"""Bytes on disk and seconds by stage of a run."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

from ibrpipe.io.assets import bytes_by_kind, listed_files, read_index
from ibrpipe.io.manifest import NAME, read_manifest
from ibrpipe.io.views import View


def bytes_of(asset: Path, photos: Sequence[View], mesh: Path) -> dict[str, int]:
    """Return the sizes of the asset, its parts, and what it was made from.

    Keys: ``asset`` (all of its own files), ``layers``, ``residuals`` (view dependence of all kinds) and ``asset_other``
    (its parts), ``photos`` (the training photos' files as they came), ``masks``, ``mesh``.
    """
    whole = _total(asset / name for name in listed_files(asset) if name != NAME)
    layers = _total(asset / texture.layers for texture in read_index(asset).textures)
    residuals = sum(view_dependence_bytes(asset).values())
    return {
        "asset": whole,
        "layers": layers,
        "residuals": residuals,
        "asset_other": whole - layers - residuals,
        "photos": photo_bytes(photos),
        "masks": _total(view.mask for view in photos if view.mask is not None),
        "mesh": _total([mesh]),
    }


def photo_bytes(photos: Sequence[View]) -> int:
    """Return the bytes of the photos' files as they came."""
    return _total(view.image for view in photos)


def view_dependence_bytes(asset: Path) -> dict[str, int]:
    """Return the bytes of every kind of view dependence in an asset folder; empty = it has none."""
    return bytes_by_kind(read_index(asset), asset)


def seconds_of(run: Path | None, own: str) -> dict[str, float]:
    """Return stage to seconds from the manifests below the run folder, in the order they were written."""
    found: list[tuple[float, str, float]] = []
    for path in sorted(run.glob(f"*/{NAME}")) if run is not None else []:
        manifest = read_manifest(path.parent)
        if manifest is not None and manifest.stage != own:
            found.append((path.stat().st_mtime, manifest.stage, manifest.seconds))
    return {stage: seconds for _, stage, seconds in sorted(found)}


def _total(paths: Iterable[Path]) -> int:
    return sum(path.stat().st_size for path in set(paths) if path.is_file())
