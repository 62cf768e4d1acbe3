"""Files that appear whole or not at all."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

from ibrpipe.errors import ConfigError, ResourceError


def write_files(folder: Path, files: Mapping[str, bytes]) -> None:
    """Write files by name into `folder`, which is made where it is missing; all are complete before one gets its name.

    Raises
    ------
    ResourceError
        One cannot be written.
    """
    drafts = {name: folder / f".{name}.partial" for name in files}
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, content in files.items():
            drafts[name].write_bytes(content)
        for name, draft in drafts.items():
            draft.replace(folder / name)
    except OSError as error:
        raise ResourceError(f"{folder}: cannot write {', '.join(files)}: {error.strerror or error}") from error
    finally:
        for draft in drafts.values():
            with suppress(OSError):
                draft.unlink(missing_ok=True)


def check_file(target: Path) -> None:
    """Refuse a target that is a folder.

    Raises
    ------
    ConfigError
        It is one.
    """
    if target.is_dir():
        raise ConfigError(f"{target}: is a folder; name a file")
