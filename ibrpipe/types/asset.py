"""Finished assets."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from ibrpipe.errors import ValueRangeError
from ibrpipe.types.arrays import Array
from ibrpipe.types.bounds import bounds_of
from ibrpipe.types.preview import preview_html
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

    def _repr_html_(self) -> str:
        """Return what notebooks show: a picture, the facts, and how to see more."""
        return preview_html(self.textures, self.info)

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Lowest and highest corner (3,) float64 of all samples, world; a background does not count.

        Raises
        ------
        ValueRangeError
            The asset holds no sample.
        """
        return bounds_of(self.textures, self.info)

    @property
    def kinds(self) -> tuple[str, ...]:
        """Kinds of view dependence that some texture has, in the order in which they are met."""
        return tuple(dict.fromkeys(part.kind for texture in self.textures for part in texture.components))

    def predicting(self) -> Asset:
        """Return the asset as it shows views that it was not given; see `ViewDependence.predicting`."""
        return Asset(
            tuple(Texture(each.layers, tuple(part.predicting() for part in each.components)) for each in self.textures),
            self.info,
        )

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
