"""Kernels that a second process compiles while the first frame compiles others: a cold start takes both cores.

Compiling holds a lock, so threads would not help. The second process only fills the cache of :mod:`ibrpipe.core.jit`,
from which the kernel is then loaded; where it cannot be started or fails, the first process compiles all by itself.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path

import numba
from numba.core.sigutils import normalize_signature

from ibrpipe.compile_progress import still_waiting
from ibrpipe.core import jit

PROGRAM = (  # garbage: see ibrpipe.compile_progress
    "import gc, sys; gc.disable(); "
    "from ibrpipe.renderers.background_compile import compile_named; compile_named(sys.argv[1:])"
)
#: seconds after which the second process is no longer waited for, and between looks at it
PATIENCE, LOOK = 60.0, 0.5


@dataclass(frozen=True)
class Kernel:
    """A kernel by its module below `ibrpipe.core`, its name, and the types of its arguments as Numba writes them."""

    module: str
    name: str
    types: str

    @property
    def text(self) -> str:
        """Module, name and types in one."""
        return f"{self.module}:{self.name}:{self.types}"


@dataclass
class BackgroundCompile:
    """What a second process compiles for the first call of a renderer.

    `meanwhile`: what the first process compiles, if it is to wait, before it does.
    """

    kernels: Sequence[Kernel]
    meanwhile: Sequence[Kernel] = ()
    _process: subprocess.Popen[bytes] | None = field(default=None, repr=False)
    _begun: bool = False

    def begin(self) -> None:
        """Start the second process, once, where anything is to be compiled and there are two processors."""
        if self._begun:
            return
        self._begun = True
        if numba.config.DISABLE_JIT or numba.config.NUMBA_NUM_THREADS < 2:
            return
        missing = [each.text for each in self.kernels if not is_cached(each)]
        if not missing or "python" not in Path(sys.executable or "").name.lower():  # a program that embeds Python
            return
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}
        nothing = subprocess.DEVNULL
        try:
            self._process = subprocess.Popen(
                [sys.executable, "-c", PROGRAM, *missing],
                env=environment,
                stdin=nothing,
                stdout=nothing,
                stderr=nothing,
            )
        except OSError:
            self._process = None

    def wait(self) -> None:
        """Wait until the second process is done."""
        if self._process is None:
            return
        for each in self.meanwhile:
            if self._process.poll() is None:
                compile_named([each.text])
        end = time.monotonic() + PATIENCE
        while not _ended(self._process, LOOK):
            still_waiting()
            if time.monotonic() >= end:
                self._process.kill()
                self._process.wait()  # none is left behind, and none is told as still running
        self._process = None


def _ended(process: subprocess.Popen[bytes], seconds: float) -> bool:
    """Whether a process ends within some seconds."""
    try:
        process.wait(seconds)
    except subprocess.TimeoutExpired:
        return False
    return True


def is_cached(kernel: Kernel) -> bool:
    """Whether compiled code of a kernel lies in the cache; True, too, where there is no cache."""
    file = Path(jit.__file__).parent.joinpath(*kernel.module.split(".")).with_suffix(".py")
    folder = jit._cache_folder(str(file))
    return folder is None or any(Path(folder).rglob(f"{file.stem}.{kernel.name}-*.nbi"))


def compile_named(names: Sequence[str]) -> None:
    """Compile kernels given as ``module:name:types`` into the cache."""
    for name in names:
        module, kernel, types = name.split(":", 2)
        arguments, _ = normalize_signature(types)  # the cache is asked for types, not for their text
        getattr(import_module(f"ibrpipe.core.{module}"), kernel).compile(arguments)
