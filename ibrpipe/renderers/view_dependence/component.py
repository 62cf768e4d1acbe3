"""Components as renderers see them: tables built once of all textures, and a pass that changes a finished picture.

The view-independent picture is complete before the first component is added (gong-yang, sec. 5.1). Components are added
kind by kind, in the order in which the sources name them; each sees what those before it have left.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

from ibrpipe.io.components import find_kind
from ibrpipe.renderers.pixel_grid import PixelGrid
from ibrpipe.types import Array, Camera, Texture
from ibrpipe.types.renderable import GridSource

if TYPE_CHECKING:
    from ibrpipe.renderers.scene import Scene


@dataclass(frozen=True, eq=False)
class Picture:
    """A picture in the making, and all that is known of it.

    Attributes
    ----------
    scene : Scene
        What is rendered: its fields, by `records` the sample behind every hit, by `sheets` pyramids for further rays.
    camera : Camera
    color : (H, W, 3) float32, linear light; to be changed in place
    depth : (H, W) float32, along camera z, scene units; +inf where nothing is hit
    ids : (H, W) uint32, number of the patch or cell that is hit, as `scene` counts them
    known : (H, W) float32, 0 where the colour is not known and nothing may be added
    grid : PixelGrid, optional
        Where the rays pass through the camera's picture; absent = through its pixels' centres.
    """

    scene: Scene
    camera: Camera
    color: Array
    depth: Array
    ids: Array
    known: Array
    grid: PixelGrid | None = None

    @property
    def places(self) -> PixelGrid:
        """Where the rays pass through the camera's picture."""
        return self.grid or PixelGrid.centers(*self.depth.shape)

    @property
    def rays(self) -> Array:
        """(H, W, 3) float64, directions of all rays in the world, one unit of depth long."""
        return self.camera.pixel_rays(self.places.points.reshape(-1, 2)).reshape(*self.depth.shape, 3)


class Tables(Protocol):
    """What a component needs for drawing."""

    @property
    def bytes(self) -> int:
        """Bytes held beyond the sources."""


@runtime_checkable
class ComponentDrawer(Protocol):
    """How one kind of view dependence is drawn; made without arguments."""

    def prepare(self, textures: Sequence[GridSource]) -> Tables:
        """Build once what `add` needs of all sources; some have no component of the kind.

        Raises
        ------
        RendererError
            The components cannot be drawn together.
        """

    def add(self, tables: Any, picture: Picture) -> Mapping[str, Any]:
        """Change `picture.color` in place where it is known; return figures for the frame's stats."""


@dataclass(frozen=True, eq=False)
class PreparedComponent:
    """All components of one kind, ready to be added to pictures."""

    kind: str
    drawer: ComponentDrawer
    tables: Tables

    @property
    def bytes(self) -> int:
        """Bytes held beyond the sources."""
        return self.tables.bytes

    def add(self, picture: Picture) -> Mapping[str, Any]:
        """Add them to a picture in place; return figures for the frame's stats."""
        return self.drawer.add(self.tables, picture)


def prepare_components(textures: Sequence[GridSource]) -> tuple[PreparedComponent, ...]:
    """Build the tables of every kind that the sources have, in the order in which they name them.

    Raises
    ------
    ConfigError
        A kind is not registered, or its package is broken.
    RendererError
        The components of a kind cannot be drawn together.
    """
    kinds = dict.fromkeys(part.kind for each in textures if isinstance(each, Texture) for part in each.components)
    found = []
    for kind in kinds:
        drawer: ComponentDrawer = find_kind(kind).part("drawing", ComponentDrawer)
        found.append(PreparedComponent(kind, drawer, drawer.prepare(textures)))
    return tuple(found)
