"""What ran: settings, input hashes, versions, seconds and memory of one stage, next to what it wrote.

Hashes are BLAKE2b with 16-byte digests, in hexadecimal. A file's hash is remembered by its size and modification time.
"""

from __future__ import annotations

import hashlib
import json
import os
import time
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from ibrpipe.errors import FormatError, MissingFileError
from ibrpipe.io.untrusted.boundary import check_regular, reason

NAME = "manifest.json"
RUN_NAME = "run.json"
_RACY_SECONDS = 2.0


class Manifest(BaseModel):
    """The content of ``manifest.json``."""

    model_config = ConfigDict(frozen=True, extra="ignore")

    schema_version: Literal[1] = 1
    stage: str = Field(description="Name of the stage")
    key: str = Field(description="Hash of all that decides the result; equal key, equal result")
    config: dict[str, Any] = Field(description="All settings, defaults included")
    inputs: dict[str, str] = Field(description="Input name to content hash (or plain value)")
    upstream: dict[str, str] = Field(description="Stage whose output is read to its key")
    code: str = Field(description="Hash of the sources that the stage imports from ibrpipe")
    versions: dict[str, str] = Field(description="Package to version")
    files: dict[str, int] = Field(description="Every file written, relative to the folder, to its size in bytes")
    seconds: float = Field(ge=0, description="Wall-clock time of the stage, s")
    peak_memory_bytes: int | None = Field(description="Largest resident memory while the stage ran; null = unknown")


def digest(value: Any) -> str:
    """Return the hash of a JSON value."""
    text = json.dumps(value, sort_keys=True, ensure_ascii=True, separators=(",", ":"), default=str)
    return hashlib.blake2b(text.encode(), digest_size=16).hexdigest()


def write_json(path: Path, value: Any) -> None:
    """Write `value` to `path` in one step."""
    write_text(path, json.dumps(value, indent=2, ensure_ascii=False, default=str) + "\n")


def write_text(path: Path, text: str) -> None:
    """Write `text` to `path` in one step, so that no reader ever sees half of it."""
    partial = path.with_name(f".{path.name}.partial-{os.getpid()}")
    try:
        partial.write_text(text, encoding="utf-8")
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)


def write_manifest(folder: Path, manifest: Manifest) -> None:
    """Write `manifest` into `folder`."""
    write_json(folder / NAME, manifest.model_dump(mode="json"))


def read_manifest(folder: Path) -> Manifest | None:
    """Return the manifest in `folder`, or None where there is none or it is not one of ours."""
    try:
        return Manifest.model_validate_json((folder / NAME).read_bytes())
    except (OSError, ValidationError):
        return None


def files_below(folder: Path, leave_out: Iterable[Path] = ()) -> Iterator[Path]:
    """Yield the files below `folder` in sorted order, without hidden ones, manifests, run folders and `leave_out`."""
    left_out = {path.resolve() for path in leave_out}
    for root, folders, names in os.walk(folder, followlinks=True):
        here = Path(root)
        for name in folders:
            if (here / name).is_symlink() and here.resolve().is_relative_to((here / name).resolve()):
                raise FormatError(f"{here / name}: is a link to a folder around it; remove it")
        folders[:] = sorted(name for name in folders if not _skipped(here / name, left_out))
        yield from (here / name for name in sorted(names) if not name.startswith(".") and name != NAME)


def _skipped(folder: Path, left_out: set[Path]) -> bool:
    return folder.name.startswith(".") or (folder / RUN_NAME).is_file() or folder.resolve() in left_out


class Hasher:
    """Content hashes of files and folders, remembered between runs in one JSON file.

    Parameters
    ----------
    memory : Path, optional
        File that holds what is known from earlier runs; it need not exist.
    """

    def __init__(self, memory: Path | None = None) -> None:
        self._memory = memory
        self._known: dict[str, list[Any]] = {}
        if memory is not None and memory.is_file():
            self._known = _read_memory(memory)
        self._used: dict[str, list[Any]] = {}

    def file(self, path: Path) -> str:
        """Return the hash of one file's content.

        Raises
        ------
        MissingFileError, FormatError
            There is no such file, or it is a pipe, a device, a link to itself, or not to be read.
        """
        try:
            name = str(path.resolve())
            before = path.stat()
            check_regular(path, before)
            entry = self._used.get(name) or self._known.get(name)
            if entry is None or entry[:2] != [before.st_size, before.st_mtime_ns]:
                with path.open("rb") as handle:
                    content = hashlib.file_digest(handle, lambda: hashlib.blake2b(digest_size=16)).hexdigest()
                entry = [before.st_size, before.st_mtime_ns, content]
        except FileNotFoundError as error:
            raise MissingFileError(f"{path} does not exist; it is an input") from error
        except (OSError, RuntimeError) as error:
            raise FormatError(
                f"{path}: cannot be read ({reason(error)}); take it out of the folder, or mend it"
            ) from error
        if time.time() - before.st_mtime > _RACY_SECONDS:
            self._used[name] = entry
        return str(entry[2])

    def tree(self, path: Path, leave_out: Iterable[Path] = ()) -> str:
        """Return the hash of a file, or of the names and contents of all files below a folder."""
        if not path.is_dir():
            return self.file(path)
        return digest([[each.relative_to(path).as_posix(), self.file(each)] for each in files_below(path, leave_out)])

    def remember(self) -> None:
        """Write what was learnt to the memory file, be it nothing yet: fresh files are hashed again next time."""
        if self._memory is not None and (self._used != self._known or not self._memory.is_file()):
            write_json(self._memory, self._used)


def _read_memory(path: Path) -> dict[str, list[Any]]:
    try:
        known = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return {}
    usable = isinstance(known, dict) and all(isinstance(entry, list) and len(entry) == 3 for entry in known.values())
    return known if usable else {}


def difference(old: Manifest | None, new: Mapping[str, Any], folder: Path) -> str | None:
    """Say why a stage has to run again, or return None when `old` still matches.

    Parameters
    ----------
    old : Manifest or None
        What is on disk.
    new : mapping
        ``key``, ``config``, ``inputs``, ``upstream``, ``code`` and ``versions`` as they are now.
    folder : Path
        Where the files of `old` should be.
    """
    if old is None:
        return "not run yet"
    if old.key != new["key"]:
        return _what_changed(old, new)
    lost = [name for name, size in old.files.items() if not _has_size(folder / name, size)]
    return f"output changed or lost: {lost[0]}" if lost else None


def _has_size(path: Path, size: int) -> bool:
    try:
        return path.is_file() and path.stat().st_size == size
    except OSError:  # a name that no file can have
        return False


def _what_changed(old: Manifest, new: Mapping[str, Any]) -> str:
    labels = {"config": "settings", "inputs": "inputs", "versions": "versions", "upstream": "earlier stages"}
    for part, label in labels.items():
        before, now = getattr(old, part), new[part]
        names = sorted(name for name in {*before, *now} if before.get(name) != now.get(name))
        if names:
            return f"{label} changed: {', '.join(names)}"
    return "code changed"
