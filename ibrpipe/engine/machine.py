"""What machine and which versions figures were measured on."""

from __future__ import annotations

import os
import platform
from pathlib import Path

import numba
from pydantic import Field

from ibrpipe.config import Document
from ibrpipe.engine.provenance import versions


class Machine(Document):
    """What the figures were measured on."""

    cpu: str = Field(description="Processor as the system names it")
    cores: int = Field(description="Logical processors this process may use")
    threads: int = Field(description="Threads of the kernels")
    system: str = Field(description="Operating system")
    python: str = Field(description="Python version")
    versions: dict[str, str] = Field(description="Versions of ibrpipe and of the libraries that matter")


def describe_machine() -> Machine:
    """Return processor, cores, threads of the kernels, system and versions."""
    return Machine(
        cpu=_processor(),
        cores=_usable_cores(),
        threads=numba.get_num_threads(),
        system=f"{platform.system()} {platform.release()} {platform.machine()}",
        python=platform.python_version(),
        versions={name: version for name, version in versions().items() if name != "python"},
    )


def _usable_cores() -> int:
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _processor() -> str:
    """Return the processor's name as the system gives it."""
    listing = Path("/proc/cpuinfo")
    if listing.is_file():
        for line in listing.read_text(encoding="utf-8", errors="replace").splitlines():
            name, _, value = line.partition(":")
            if name.strip() == "model name":
                return value.strip()
    return platform.processor() or platform.machine()
