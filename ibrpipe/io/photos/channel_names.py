"""Names of an image file's channels as we use them: R, G, B, A, Y and Z, whatever layer they are in.

Multilayer OpenEXR files name channels LAYER.NAME; Blender writes ``ViewLayer.Combined.R``, ``ViewLayer.Depth.Z``, and a
lone pass as ``V``.
"""

from __future__ import annotations

from collections.abc import Sequence

#: Layers that hold the whole picture, best first, and words of layers whose R, G, B are no colours of it
_WHOLE = ("combined", "composite", "rgba", "beauty", "image", "color", "colour")
_NO_COLOUR = ("normal", "position", "vector", "uv", "denoising", "crypto", "index", "mist", "shadow", "depth")
_NO_DEPTH = ("normal", "position", "vector", "uv", "denoising")


def plain_names(names: tuple[str, ...]) -> tuple[str, ...]:
    """Return the names with those of the layer of the picture, and of depth, made plain.

    Files that have plain R, G, B (or Y) keep all names; the same holds for depth with Z.
    """
    lower = [name.lower().rpartition(".") for name in names]
    known = {name.upper() for name in names if "." not in name}
    renamed = list(names)
    if not ({"R", "G", "B"} <= known or "Y" in known):
        layer = _picture_layer(lower)
        for index, (above, _, last) in enumerate(lower):
            if above == layer and last in ("r", "g", "b", "a") and layer is not None:
                renamed[index] = last.upper()
    if "Z" not in known:
        depth = _depth_channel(lower)
        if depth is not None:
            renamed[depth] = "Z"
    return tuple(renamed)


def best_part(parts: Sequence[tuple[str, tuple[str, ...]]], wanted: str) -> int:
    """Return which part of a file holds a channel: one called as the whole picture, else the first; 0 if none does.

    Parameters
    ----------
    parts : sequence of (str, tuple of str)
        Name and channels of every part.
    wanted : str
        R or Z.
    """
    layered = [tuple(f"{name}.{channel}" if name else channel for channel in channels) for name, channels in parts]
    having = [
        index
        for index, (own, (_, channels)) in enumerate(zip(layered, parts))
        if wanted in plain_names(own) or (wanted in plain_names(channels) and not _is_data(parts[index][0]))
    ]
    for word in _WHOLE:
        for index in having:
            if word in parts[index][0].lower():
                return index
    return having[0] if having else 0


def _is_data(name: str) -> bool:
    return any(word in name.lower() for word in _NO_COLOUR)


def _picture_layer(names: Sequence[tuple[str, str, str]]) -> str | None:
    """The layer whose R, G, B are the picture: one called as such, else the first that is no pass of data."""
    layers = list(dict.fromkeys(above for above, _, _ in names))
    full = [layer for layer in layers if {"r", "g", "b"} <= {last for above, _, last in names if above == layer}]
    for word in _WHOLE:
        for layer in full:
            if layer.rpartition(".")[2].startswith(word):
                return layer
    colours = [layer for layer in full if not any(word in layer for word in _NO_COLOUR)]
    return colours[0] if colours else None


def _depth_channel(names: Sequence[tuple[str, str, str]]) -> int | None:
    """The channel Z of a layer of depth, else a V that stands alone or in such a layer."""
    for wanted, needs_word in (("z", True), ("v", True), ("v", False), ("z", False)):
        for index, (above, _, last) in enumerate(names):
            words = above if above else last
            if last != wanted or any(word in words for word in _NO_DEPTH):
                continue
            if "depth" in above or (not needs_word and (not above or wanted == "z")):
                return index
    return None
