"""Bytes on disk and seconds by stage of a run."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

from ibrpipe.io.manifest import NAME, read_manifest
from ibrpipe.io.views import View


def bytes_of(asset: Path, photos: Sequence[View], mesh: Path) -> dict[str, int]:
    """Return the sizes of the asset, its parts, and what it was made from.

    Keys: ``asset`` (all of its files), ``layers``, ``residuals`` and ``asset_other`` (its parts by file name),
    ``photos`` (the training photos' files as they came), ``masks``, ``mesh``.
    """
    parts = {"layers": 0, "residuals": 0, "asset_other": 0}
    for path in asset.rglob("*"):
        if path.is_file() and path.name != NAME:
            kind = path.name.split(".")[0].split("_")[0]
            parts[kind if kind in parts else "asset_other"] += path.stat().st_size
    return {
        "asset": sum(parts.values()),
        **parts,
        "photos": _total(view.image for view in photos),
        "masks": _total(view.mask for view in photos if view.mask is not None),
        "mesh": _total([mesh]),
    }


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
