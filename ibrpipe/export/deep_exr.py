"""Layers as deep OpenEXR, which deep-aware compositors open; still an asset folder that ibrpipe reads."""

from __future__ import annotations

import shutil
from pathlib import Path

from ibrpipe.errors import ConfigError, ResourceError
from ibrpipe.export.registry import Exporter
from ibrpipe.export.whole_file import check_folder
from ibrpipe.io.assets import INDEX, listed_files, read_asset, read_index
from ibrpipe.io.own_files import put_in_place, recover
from ibrpipe.io.recoding import finish, recode


def write(source: Path, target: Path) -> None:
    """Write the asset in folder `source` into the folder `target` with its layers as deep OpenEXR.

    What an earlier export left there is replaced; other files in it stay.

    Raises
    ------
    ConfigError
        `target` holds something else, or is `source`.
    MissingFileError, FormatError
        The asset is missing or damaged.
    ResourceError
        The folder cannot be written.
    """
    if target.resolve() == source.resolve():
        raise ConfigError(f"{target} is the asset itself; name another folder")
    check_folder(target, INDEX, "asset")
    index, asset = read_index(source), read_asset(source)
    draft = target.with_name(f".{target.name}.partial")
    try:
        recover(target, listed_files)
        shutil.rmtree(draft, ignore_errors=True)
        draft.mkdir(parents=True)
        fresh = recode(source, index, asset, draft, None)
        finish(fresh, draft, [texture.measured.get("coding") for texture in index.textures])
        put_in_place(draft, target, listed_files)
    except OSError as error:
        if isinstance(error, ResourceError):
            raise
        raise ResourceError(f"{target}: cannot write: {error.strerror or error}") from error
    finally:
        shutil.rmtree(draft, ignore_errors=True)


EXPORTER = Exporter("deep-exr", "Asset folder with layers as deep OpenEXR, for compositors.", write)
