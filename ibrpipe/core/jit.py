"""The only jit decorators of the project.

``helper`` compiles scalar functions that kernels call, ``kernel`` compiles loops with ``prange`` over rows (each
row written by one thread, so the thread count never changes a byte), ``serial`` compiles loops whose order matters.
Fast-math is a subset without ``nnan`` and ``ninf``: holes are NaN and misses are infinite here.
Compiled code is cached in a folder named by a hash of the kernel sources, so an edit in any kernel module is seen.
"""

from __future__ import annotations

import hashlib
import os
import sys
from collections.abc import Callable
from typing import Any

import numba

FAST_MATH = {"nsz", "arcp", "contract", "afn", "reassoc"}

numba.config.THREADING_LAYER_PRIORITY = ["omp", "workqueue", "tbb"]


def _cache_root() -> str:
    chosen = os.environ.get("IBRPIPE_CACHE_DIR")
    if chosen:
        return chosen
    if sys.platform == "win32":
        base = os.environ.get("LOCALAPPDATA", os.path.expanduser("~"))
    else:
        base = os.environ.get("XDG_CACHE_HOME", os.path.expanduser("~/.cache"))
    return os.path.join(base, "ibrpipe")


def _source_digest() -> str:
    here = os.path.dirname(os.path.abspath(__file__))
    digest = hashlib.blake2b(numba.__version__.encode(), digest_size=8)
    for name in sorted(os.listdir(here)):
        if name.endswith(".py"):
            with open(os.path.join(here, name), "rb") as source:
                digest.update(source.read())
    return digest.hexdigest()


def _cache_folder() -> str | None:
    folder = os.path.join(_cache_root(), "kernels-" + _source_digest())
    try:
        os.makedirs(folder, exist_ok=True)
        probe = os.path.join(folder, f".probe-{os.getpid()}")
        with open(probe, "w") as handle:
            handle.write("")
        os.remove(probe)
    except OSError:
        return None
    return folder


_FOLDER = _cache_folder()


def _compile(function: Callable[..., Any], **options: Any) -> Any:
    settings = {"fastmath": FAST_MATH, "error_model": "numpy", "nogil": True, **options}
    if _FOLDER is None:
        return numba.njit(**settings)(function)
    before = numba.config.CACHE_DIR
    numba.config.CACHE_DIR = _FOLDER
    try:
        return numba.njit(cache=True, **settings)(function)
    finally:
        numba.config.CACHE_DIR = before


def helper(function: Callable[..., Any]) -> Any:
    """Compile a scalar function that kernels call."""
    return _compile(function)


def inlined(function: Callable[..., Any]) -> Any:
    """Compile a scalar function that is copied into its callers (short bodies in hot loops)."""
    return _compile(function, inline="always")


def fused(function: Callable[..., Any]) -> Any:
    """Compile a function whose machine code is always merged into its callers (many arrays, hot loops)."""
    return _compile(function, forceinline=True)


def ordered(function: Callable[..., Any]) -> Any:
    """Compile a function whose sums must be taken in the written order (differences of nearly equal numbers)."""
    return _compile(function, fastmath={"nsz", "contract"})


def kernel(function: Callable[..., Any]) -> Any:
    """Compile a loop over rows that runs on all threads."""
    return _compile(function, parallel=True)


def serial(function: Callable[..., Any]) -> Any:
    """Compile a loop that runs on one thread because its order matters."""
    return _compile(function)
