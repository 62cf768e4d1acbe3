"""What a result depends on besides its inputs (ibrpipe's own sources, library versions), and what it cost."""

from __future__ import annotations

import ast
import hashlib
import platform
import re
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from functools import cache
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path

from ibrpipe.version import VERSION

_DOTTED = re.compile(r"[a-z_]\w*(\.[a-z_]\w*)+(:\w+)?")
_PACKAGES = (
    "numba",
    "numpy",
    "open3d",
    "open3d-cpu",
    "opencv-contrib-python-headless",
    "OpenImageIO",
    "pycolmap",
    "scikit-image",
    "scipy",
    "trimesh",
)


@cache
def versions() -> dict[str, str]:
    """Return the versions of Python, ibrpipe and the libraries that can change a result."""
    found = {"python": platform.python_version(), "ibrpipe": VERSION}
    for package in _PACKAGES:
        try:
            found[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            continue
    return found


@cache
def code_digest(module: str) -> str:
    """Return the hash of the sources of `module` and of everything it imports from the same top package."""
    names, waiting = set[str](), [module]
    while waiting:
        name = waiting.pop()
        if name not in names:
            names.add(name)
            waiting.extend(_imports(name))
    known = hashlib.blake2b(digest_size=16)
    for name in sorted(names):
        for path in _sources(name):
            known.update(f"{name}/{path.name}\0".encode() + path.read_bytes())
    return known.hexdigest()


@cache
def _sources(module: str) -> tuple[Path, ...]:
    """Return a module's file; of a package also the files in it that are no Python (templates, tables)."""
    origin = _file(module)
    if origin is None:
        return ()
    if origin.name != "__init__.py":
        return (origin,)
    others = (path for path in origin.parent.iterdir() if path.is_file() and path.suffix not in {".py", ".pyc"})
    return (origin, *sorted(others))


@cache
def _file(module: str) -> Path | None:
    """Return the source file of a module, found without importing it; None where there is none."""
    top, *rest = module.split(".")
    start = _top_file(top)
    if start is None or not rest:
        return start
    path = start.parent.joinpath(*rest)
    return next((file for file in (path.with_suffix(".py"), path / "__init__.py") if file.is_file()), None)


@cache
def _top_file(name: str) -> Path | None:
    try:
        spec = find_spec(name)
    except ValueError:
        return None
    return Path(spec.origin) if spec is not None and spec.origin and Path(spec.origin).is_file() else None


@cache
def _imports(module: str) -> frozenset[str]:
    """Return the modules of the same top package that `module` imports, or names in a string to import late."""
    top = module.partition(".")[0]
    found = set[str]()
    for path in (path for path in _sources(module) if path.suffix == ".py"):
        for node in ast.walk(ast.parse(path.read_bytes())):
            found.update(_named(node, top))
    return frozenset(found)


def _named(node: ast.AST, top: str) -> Iterator[str]:
    if isinstance(node, ast.Import):
        yield from (alias.name for alias in node.names if alias.name.partition(".")[0] == top)
    elif isinstance(node, ast.ImportFrom) and node.module and node.module.partition(".")[0] == top:
        yield node.module
        for alias in node.names:
            if _file(f"{node.module}.{alias.name}"):
                yield f"{node.module}.{alias.name}"
    elif isinstance(node, ast.Constant) and isinstance(node.value, str) and _DOTTED.fullmatch(node.value):
        name = node.value.partition(":")[0]
        for candidate in (name, f"{top}.{name}"):
            if candidate.partition(".")[0] == top and _file(candidate):
                yield candidate


@dataclass
class Cost:
    """Seconds and largest resident memory (None = unknown) of a block of code."""

    seconds: float = 0.0
    peak_memory_bytes: int | None = None


#: Largest resident memory of the child processes of the block that is being measured, one entry each
_CHILDREN: ContextVar[list[int] | None] = ContextVar("child_memory", default=None)


@contextmanager
def measured() -> Iterator[Cost]:
    """Measure the block; the figures are filled in when it ends.

    Memory is this process's and that of the largest child process that `count_child` was told of, together: the child
    works while the parent waits.
    """
    cost = Cost()
    fresh = _reset_peak()
    children: list[int] = []
    token = _CHILDREN.set(children)
    start = time.perf_counter()
    try:
        yield cost
    finally:
        _CHILDREN.reset(token)
    cost.seconds = time.perf_counter() - start
    own = peak_memory() if fresh else _peak_of_process()
    cost.peak_memory_bytes = None if own is None else own + max(children, default=0)


def count_child(peak_memory_bytes: int | None) -> None:
    """Add a child process, which has ended, to the memory of the block that is being measured."""
    children = _CHILDREN.get()
    if children is not None and peak_memory_bytes is not None:
        children.append(peak_memory_bytes)


def _reset_peak() -> bool:
    """Set Linux's high-water mark of resident memory back; False where that is not possible."""
    try:
        Path("/proc/self/clear_refs").write_text("5")
    except OSError:
        return False
    return True


def peak_memory() -> int | None:
    """Return the largest resident memory of this process in bytes, on Linux since it was last set back; None = unknown.

    Linux's own count is asked first: the other one starts, in a child process, with the memory of its parent.
    """
    status = Path("/proc/self/status")
    for line in status.read_text().splitlines() if status.is_file() else ():
        if line.startswith("VmHWM:"):
            return int(line.split()[1]) * 1024
    return _peak_of_process()


def _peak_of_process() -> int | None:
    if sys.platform == "win32":
        return None
    import resource

    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else peak * 1024
