"""``ibrpipe.export``: any exporter from Python."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from ibrpipe.errors import ConfigError
from ibrpipe.export.asset_folders import FINISHED, asset_folder
from ibrpipe.export.registry import Exporter, exporter_for
from ibrpipe.io.assets import write_asset
from ibrpipe.io.yaml_settings import Settings, validated
from ibrpipe.types import Asset


def export(source: Asset | str | Path, target: str | Path, form: str | None = None, **settings: Any) -> str | None:
    """Write an asset, or what a folder holds, in another form.

    Parameters
    ----------
    source : Asset, or path
        An asset folder, a run folder, a capture, or a scene, as the form wants it.
    target : path
        File or folder to write.
    form : str, optional
        Name of the exporter; left out = by the ending of `target`.
    **settings
        Of the form, such as ``tolerance=2``; ``notes=path`` where it takes notes.

    Returns
    -------
    str or None
        What there is to tell, such as what is lost.

    Raises
    ------
    ConfigError
        There is no such form, it cannot take an asset in memory, or a setting is wrong.
    as the exporter
    """
    target = Path(target)
    exporter = exporter_for(target, form)
    more = _more(exporter, settings)
    if not isinstance(source, Asset):
        folder = asset_folder(Path(source)) if exporter.takes == "asset" else Path(source)
        return exporter.write(folder, target, *more)
    if exporter.takes not in ("asset", "any"):
        raise ConfigError(
            f"the form {exporter.name} takes a {exporter.takes} folder, no asset in memory; give its path"
        )
    with TemporaryDirectory() as scratch:
        place = Path(scratch) / target.stem / FINISHED
        write_asset(source, place)
        return exporter.write(place, target, *more)


def _more(exporter: Exporter, settings: dict[str, Any]) -> list[Any]:
    """Return what `Exporter.write` takes beside source and target."""
    if exporter.takes_notes:
        unknown = sorted(set(settings) - {"notes"})
        if unknown:
            raise ConfigError(f"the form {exporter.name} has no setting {unknown[0]!r}; it takes notes alone")
        return [Path(settings["notes"])] if settings.get("notes") is not None else []
    if exporter.Options is not None:
        return [validated(exporter.Options, Settings(settings, {(): f"export as {exporter.name}"}))]
    if settings:
        raise ConfigError(f"the form {exporter.name} has no setting {sorted(settings)[0]!r}; leave it out")
    return []
