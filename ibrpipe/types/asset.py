"""Finished assets, and the pictures that are rendered of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from ibrpipe.types.arrays import Array
from ibrpipe.types.view_dependence import SpiralTexture


@dataclass(frozen=True, eq=False)
class Asset:
    """A finished asset: any number of spiral textures and what is known of their making.

    Attributes
    ----------
    textures : tuple of SpiralTexture
    info : mapping
        The content of ``asset.json`` (units, provenance, measured errors); empty for assets made in memory.
    """

    textures: tuple[SpiralTexture, ...]
    info: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Frame:
    """A rendered picture. What was not asked for is None.

    Attributes
    ----------
    color : (H, W, 3) float32, linear light, 0 where nothing is hit
    depth : (H, W) float32, along camera z, scene units, +inf where nothing is hit
    alpha : (H, W) float32, 1 where something is hit
    stats : mapping of figures such as ``rays``, ``hits``, ``milliseconds``
    """

    color: Array | None
    depth: Array | None
    alpha: Array | None
    stats: Mapping[str, Any] = field(default_factory=dict)
