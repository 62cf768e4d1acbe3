"""What the steps from depth maps to a surface cost relative to each other, for the time that is left of the whole."""

from __future__ import annotations

from ibrpipe.progress import Part

#: label in progress and seconds of two cores for a million pixels of maps, in order; only proportions matter. A name
#: that no loop has (fill, solve, simplify, which stands for rims, too) is work unheard of: it ends with the next loop
_STEPS = (
    ("fuse depth maps", 0.45),
    ("outlines", 0.05),
    ("sum distances", 0.4),
    ("observations", 0.1),
    ("fill", 0.15),
    ("masks", 0.1),
    ("observations", 0.1),
    ("solve", 0.7),
    ("observations", 0.1),
    ("observations", 0.1),
    ("carry photos", 0.1),
    ("simplify", 0.8),
    ("backs", 0.1),
    ("observations", 0.1),
    ("coverage", 0.2),
)


def surface_parts(megapixels: float) -> list[Part]:
    """Return the loops from depth maps of so many millions of pixels to the finished surface, with what they cost."""
    return [Part(label, seconds * megapixels) for label, seconds in _STEPS]
