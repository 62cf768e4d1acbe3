"""Finished assets, and the pictures that are rendered of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import ibrpipe
from ibrpipe.errors import ValueRangeError
from ibrpipe.types.arrays import Array
from ibrpipe.types.texture import Texture
from ibrpipe.types.view_dependence import SharedData


@dataclass(frozen=True, eq=False)
class Asset:
    """A finished asset: any number of textures and what is known of their making.

    Attributes
    ----------
    textures : tuple of Texture
    info : mapping
        The content of ``asset.json`` (units, provenance, measured errors); empty for assets made in memory.
    """

    textures: tuple[Texture, ...]
    info: Mapping[str, Any] = field(default_factory=dict)

    def __repr__(self) -> str:
        """Return the number of textures and the kinds of view dependence; arrays are left out."""
        return f"Asset({len(self.textures)} textures, view dependence: {', '.join(self.kinds) or 'none'})"

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Lowest and highest corner (3,) float64 of all samples, world; a background does not count.

        Raises
        ------
        ValueRangeError
            The asset holds no sample.
        """
        from ibrpipe.types.bounds import bounds_of

        return bounds_of(self.textures, self.info)

    @property
    def kinds(self) -> tuple[str, ...]:
        """Kinds of view dependence that some texture has, in the order in which they are met."""
        return tuple(dict.fromkeys(part.kind for texture in self.textures for part in texture.components))

    @property
    def shared(self) -> dict[str, SharedData]:
        """What the components of a kind share among all textures, by kind.

        Raises
        ------
        ValueRangeError
            Two components of one kind refer to two different objects.
        """
        found: dict[str, SharedData] = {}
        for part in (part for texture in self.textures for part in texture.components):
            if part.shared is not None and found.setdefault(part.kind, part.shared) is not part.shared:
                raise ValueRangeError(
                    f"components of kind {part.kind!r} share two different objects; an asset holds one of each kind"
                )
        return found


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

    def __repr__(self) -> str:
        """Return the size and which arrays there are; their values are left out."""
        arrays = {"color": self.color, "depth": self.depth, "alpha": self.alpha}
        there = {name: array for name, array in arrays.items() if array is not None}
        size = "".join(f"{array.shape[1]} x {array.shape[0]}: " for array in [*there.values()][:1])
        return f"Frame({size}{', '.join(there) or 'empty'})"

    def save(self, path: Path | str) -> None:
        """Write the frame as ``.png`` (8-bit sRGB) or ``.exr`` (linear light with alpha and depth).

        Raises
        ------
        FormatError, ShapeError
            The name ends in something else; there is no colour.
        """
        ibrpipe.write_picture(self, path)

    def _repr_png_(self) -> bytes | None:
        """Return the picture that notebooks show; None without colour."""
        if self.color is None:
            return None
        with TemporaryDirectory() as folder:
            self.save(Path(folder) / "frame.png")
            return (Path(folder) / "frame.png").read_bytes()
