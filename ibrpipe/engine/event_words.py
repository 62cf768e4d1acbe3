"""What happens to stages in words, and times and sizes as a person reads them."""

from __future__ import annotations

from ibrpipe.engine.runner import Event
from ibrpipe.io.manifest import Manifest


def told(event: Event) -> str:
    """Return what happens to a stage in words: one line, and below it what the stage itself has to tell."""
    if event.kind == "starts":
        where = "" if event.position is None else f", stage {event.position[0]} of {event.position[1]}"
        return f"{event.stage}: starts ({event.text}){where}"
    if event.kind == "skipped":
        return f"{event.stage}: up to date"
    lines = [f"{event.stage}: done in {cost(event.manifest)}" if event.manifest else event.stage]
    return "\n".join([*lines, *(f"  {line}" for line in event.text.splitlines())])


def cost(manifest: Manifest) -> str:
    """Return seconds, memory and bytes written in words."""
    parts = [duration(manifest.seconds)]
    if manifest.peak_memory_bytes is not None:
        parts.append(f"{size(manifest.peak_memory_bytes)} of memory at most")
    return ", ".join([*parts, f"{size(sum(manifest.files.values()))} written"])


def duration(seconds: float) -> str:
    """Return a time in words: 0.42 s, 12.3 s, 4 min 05 s, 1 h 02 min."""
    if seconds < 59.95:
        return f"{seconds:.2f} s" if seconds < 9.995 else f"{seconds:.1f} s"
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest:02d} s" if minutes < 60 else f"{minutes // 60} h {minutes % 60:02d} min"


def size(count: float) -> str:
    """Return a number of bytes in words, in powers of 1000: 12 B, 3.4 kB, 56 MB."""
    for unit in ("B", "kB", "MB", "GB"):
        if count < 999.5 or unit == "GB":
            break
        count /= 1000
    return f"{count:.0f} {unit}" if unit == "B" or count >= 99.5 else f"{count:.3g} {unit}"
