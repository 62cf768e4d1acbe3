"""The only jit decorators of the project.

``helper`` compiles scalar functions that kernels call, ``kernel`` compiles loops with ``prange`` over rows (each
row written by one thread, so the thread count never changes a byte), ``serial`` compiles loops whose order matters;
``exact_...`` do their arithmetic as written.
Fast-math is a subset without ``nnan`` and ``ninf``: holes are NaN and misses are infinite here.
A function that kernels call is compiled anew for every literal that it is given: shared ones take ``np.int64(0)``.
Compiled code is cached per module, in a folder named by a hash of its source and of all kernel modules that it imports:
an edit in any of them is seen, an edit elsewhere compiles nothing anew, and all checkouts and environments of a user
share what is the same in them.
"""

from __future__ import annotations

import functools
import hashlib
import os
import re
import sys
from collections.abc import Callable
from typing import Any

import numba
import numba.extending
from numba.core.caching import UserProvidedCacheLocator

FAST_MATH = {"nsz", "arcp", "contract", "afn", "reassoc"}
AS_WRITTEN = {"nsz"}

numba.config.THREADING_LAYER_PRIORITY = ["omp", "workqueue", "tbb"]

_HERE = os.path.dirname(os.path.abspath(__file__))
_PACKAGE = "ibrpipe.core"
#: import statements: module and names, or modules alone. Parsing all modules took a tenth of the time to a first frame;
#: text that only looks like an import can do no more than add a file
_IMPORT = re.compile(
    r"^[ \t]*(?:from[ \t]+(ibrpipe\.core[\w.]*)[ \t]+import[ \t]+(\([^)]*\)|[^\n]*)|import[ \t]+([^\n]*))", re.MULTILINE
)
_NAME = re.compile(r"[\w.]+")


def _cache_root() -> str:
    chosen = os.environ.get("IBRPIPE_CACHE_DIR")
    if chosen:
        return chosen
    if sys.platform == "win32":
        base = os.environ.get("LOCALAPPDATA", os.path.expanduser("~"))
    else:
        base = os.environ.get("XDG_CACHE_HOME", os.path.expanduser("~/.cache"))
    return os.path.join(base, "ibrpipe")


def _file_of(module: str) -> str | None:
    """File of a module of this package by its dotted name below the package; None where there is none."""
    file = os.path.join(_HERE, *module.split(".")) + ".py"
    return file if os.path.exists(file) else None


@functools.cache
def _imported_kernels(path: str) -> tuple[str, ...]:
    """Files of the kernel modules that the module at `path` imports, whether it names the module or what is in it."""
    with open(path, encoding="utf-8") as source:
        text = source.read()
    names: set[str] = set()
    for module, parts, plain in _IMPORT.findall(text):
        names.update(_NAME.findall(plain))
        if module:
            names.add(module)
            names.update(f"{module}.{part}" for part in _NAME.findall(parts))
    below = (name.removeprefix(_PACKAGE + ".") for name in sorted(names) if name.startswith(_PACKAGE + "."))
    return tuple(file for file in map(_file_of, below) if file is not None)


@functools.cache
def _source_digest(path: str) -> str:
    """Hash of the module at `path` and of all kernel modules that it needs, however indirectly."""
    needed, queue = {path}, [path]
    while queue:
        fresh = set(_imported_kernels(queue.pop())) - needed
        needed |= fresh
        queue.extend(fresh)
    digest = hashlib.blake2b(numba.__version__.encode(), digest_size=8)
    for name in sorted(needed):
        with open(name, "rb") as source:
            digest.update(source.read())
    return digest.hexdigest()


@functools.cache
def _cache_folder(path: str) -> str | None:
    """Folder for the compiled code of the module at `path`; None where nothing can be written."""
    name = os.path.splitext(os.path.relpath(path, _HERE))[0].replace(os.sep, ".")
    folder = os.path.join(_cache_root(), f"{name}-{_source_digest(path)}")
    try:
        os.makedirs(folder, exist_ok=True)
        probe = os.path.join(folder, f".probe-{os.getpid()}")
        with open(probe, "w") as handle:
            handle.write("")
        os.remove(probe)
    except OSError:
        return None
    return folder


def kept_functions():
    # -> (folder of all compiled code, how many specialised functions lie there)
    root = _cache_root()
    return root, sum(name.endswith(".nbc") for _, _, names in os.walk(root) for name in names)


class FolderLocator(UserProvidedCacheLocator):
    """Lets Numba keep compiled code in `numba.config.CACHE_DIR` itself, not below a name made of the source's path."""

    @classmethod
    def get_suitable_cache_subpath(cls, py_file: str) -> str:
        """Return no folder: that of the cache already tells what the source is."""
        return ""


_LOCATOR = f"{__name__}.{FolderLocator.__name__}"


def _compile(function: Callable[..., Any], **options: Any) -> Any:
    settings = {"fastmath": FAST_MATH, "error_model": "numpy", "nogil": True, "no_cfunc_wrapper": True, **options}
    folder = _cache_folder(os.path.abspath(function.__code__.co_filename))
    if folder is None:
        return numba.njit(**settings)(function)
    before = numba.config.CACHE_DIR, numba.config.CACHE_LOCATOR_CLASSES
    numba.config.CACHE_DIR, numba.config.CACHE_LOCATOR_CLASSES = folder, _LOCATOR
    try:
        return numba.njit(cache=True, **settings)(function)
    finally:
        numba.config.CACHE_DIR, numba.config.CACHE_LOCATOR_CLASSES = before


def _fma(typing: Any, a: Any, b: Any, c: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        same = [context.cast(builder, arg, kind, signature.return_type) for arg, kind in zip(args, signature.args)]
        return builder.fma(*same)

    return numba.types.float32(a, b, c), generate


def _multiply_add(a: Any, b: Any, c: Any) -> Any:
    return a * b + c


#: a * b + c of float32 numbers, rounded once (twice where the compiler is off)
fma = _multiply_add if numba.config.DISABLE_JIT else numba.extending.intrinsic(_fma)


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


def fused_exact(function: Callable[..., Any]) -> Any:
    """`fused` for kernels of `exact_kernel`."""
    return _compile(function, fastmath=AS_WRITTEN, forceinline=True)


def exact_kernel(function: Callable[..., Any]) -> Any:
    """`kernel` whose arithmetic is done as written: nothing is reordered, and fused only where `fma` says so.

    A kernel is optimised once when it is compiled and once more in the copy that goes to the cache; where the compiler
    may choose, the run that compiles and later runs differ in the last bits, which iterative searches amplify.
    """
    return _compile(function, fastmath=AS_WRITTEN, parallel=True)


def serial(function: Callable[..., Any]) -> Any:
    """Compile a loop that runs on one thread because its order matters."""
    return _compile(function)


def exact_serial(function: Callable[..., Any]) -> Any:
    """`serial` whose arithmetic is done as written; for loops that threads of Python's run side by side, too.

    A loop on all threads may not be entered by several threads at once where Numba has neither OpenMP nor TBB.
    """
    return _compile(function, fastmath=AS_WRITTEN)


def foreign(function: Callable[..., Any]) -> Any:
    """Compile a loop on all threads that calls a C library; never cached: it holds addresses of this process."""
    return numba.njit(parallel=True, fastmath=FAST_MATH, error_model="numpy", nogil=True)(function)
