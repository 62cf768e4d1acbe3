"""All fields of a prepared source, what a search found in them, and the colours of what was found."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ibrpipe.core.ldi import shade
from ibrpipe.errors import RendererError
from ibrpipe.renderers.background_compile import Kernel
from ibrpipe.renderers.fields import HeightField, PatchField, build_field, texel_size
from ibrpipe.renderers.pixel_grid import PixelGrid
from ibrpipe.renderers.search.epipolar_lines import Map, height_map
from ibrpipe.renderers.search.patches import Blocks, pack_blocks
from ibrpipe.renderers.search.quadtree import Sheet, build_sheets
from ibrpipe.renderers.view_dependence.component import PreparedComponent, prepare_components
from ibrpipe.types import Array, Camera
from ibrpipe.types.renderable import GridSource

#: as the pictures of layered images call it; for those that have a second process compile it
SHADE_PATCHES = Kernel(
    "ldi.shade",
    "shade_patches",
    "(float32[:,::1], uint32[:,::1], Tuple((float64[:,::1], float64[:,::1])), int32[:,::1], float64[:,::1], "
    "float64[:,:,::1], float32[:,::1], float32[:,:,::1], float32[:,::1])",
)


@dataclass(frozen=True, eq=False)
class Scene:
    """All fields of a prepared source.

    Patches of layered images are numbered in the order of `patches`; the cells of height fields follow.

    Attributes
    ----------
    patches : tuple of (texture number, PatchField)
    heights : tuple of (texture number, HeightField, number of its first cell)
    components : tuple of PreparedComponent, all view dependence in the order in which it is added
    """

    patches: tuple[tuple[int, PatchField], ...]
    heights: tuple[tuple[int, HeightField, int], ...]
    components: tuple[PreparedComponent, ...]

    @property
    def bytes(self) -> int:
        """Bytes held beyond the sources."""
        fields = [field for _, field in self.patches] + [field for _, field, _ in self.heights]
        held = sum(field.bytes for field in fields) + sum(one.bytes for one in self.maps)
        return held + sum(component.bytes for component in self.components)

    @property
    def cells(self) -> int:
        """Cells and patches of all fields."""
        return int(self.firsts[-1]) + sum(field.cells for _, field, _ in self.heights)

    @cached_property
    def soft(self) -> bool:
        """Some samples of layered images fill only a part of their texel."""
        return any(bool(((field.color[:, 3] > 0) & (field.color[:, 3] < 1)).any()) for _, field in self.patches)

    @cached_property
    def texel(self) -> float:
        """Width of a texel on the surface of layered images, scene units, the median over them; 0 without any."""
        return float(np.median([texel_size(field) for _, field in self.patches])) if self.patches else 0.0

    @cached_property
    def firsts(self) -> Array:
        """(F + 1,) int64: number of every layered image's first patch."""
        return np.cumsum([0] + [len(field.corners) for _, field in self.patches])

    @cached_property
    def records(self) -> tuple[Array, Array]:
        """(P, 8) int32 column, row, field, 0, samples of every patch, and (S, 4) float32 colours; joined."""
        fields = [field for _, field in self.patches]
        shifts = np.cumsum([0] + [len(field.color) for field in fields])
        records = np.zeros((int(self.firsts[-1]), 8), np.int32)
        for number, field in enumerate(fields):
            own = records[self.firsts[number] : self.firsts[number + 1]]
            own[:, :2], own[:, 2] = field.cells, number
            own[:, 4:] = np.where(field.samples >= 0, field.samples + shifts[number], -1)
        return records, np.concatenate([field.color for field in fields])

    @cached_property
    def blocks(self) -> Blocks:
        """All patches as the projecting search takes them."""
        return pack_blocks([field for _, field in self.patches])

    @cached_property
    def pictures(self) -> list[Array]:
        """Working memory of finished frames, for the next ones."""
        return []

    @cached_property
    def maps(self) -> tuple[Map, ...]:
        """Height fields with the bounds of their blocks, for the search along lines."""
        made = (height_map(field, base) for _, field, base in self.heights)
        return tuple(one for one in made if one is not None)

    @cached_property
    def sheets(self) -> list[Sheet]:
        """Pyramids of all fields, for the ray search."""
        parts = [build_sheets(field, int(n)) for (_, field), n in zip(self.patches, self.firsts, strict=False)]
        parts += [build_sheets(field, base) for _, field, base in self.heights]
        return [sheet for part in parts for sheet in part]

    def texture_of(self, ids: Array) -> Array:
        """Number of the source behind every hit, int32, shaped as `ids`; -1 = nothing was hit."""
        sources = [number for number, _ in self.patches] + [number for number, _, _ in self.heights]
        firsts = [int(first) for first in self.firsts[:-1]] + [first for _, _, first in self.heights]
        of_field = np.array([*sources, -1], np.int32)
        ends = np.array([*firsts, self.cells], np.int64)
        return of_field[np.searchsorted(ends, ids.astype(np.int64), side="right") - 1]


@dataclass(frozen=True, eq=False)
class Hits:
    """Nearest hit of every pixel: camera depth (H, W) float32 (+inf = none) and number (H, W) uint32."""

    depth: Array
    ids: Array


def prepare(textures: tuple[GridSource, ...]) -> Scene:
    """Build the fields of all textures, and the tables of their view dependence."""
    components = prepare_components(textures)  # first: what they need may be compiled beside
    fields = [(number, build_field(texture)) for number, texture in enumerate(textures)]
    layered = tuple((number, field) for number, field in fields if isinstance(field, PatchField))
    base = sum(len(field.corners) for _, field in layered)
    heights = []
    for number, field in fields:
        if isinstance(field, HeightField):
            heights.append((number, field, base))
            base += field.cells
    if base >= 2**32 - 1:
        raise RendererError(
            f"the sources have {base} cells together; 4294967294 can be told apart: render fewer at once"
        )
    return Scene(layered, tuple(heights), components)


def shade_hits(scene: Scene, hits: Hits, camera: Camera, grid: PixelGrid | None = None) -> tuple[Array, Array]:
    """Return the view-independent colour (H, W, 3) of `hits` and where it is known (H, W), float32.

    `grid` tells where the rays of the hits pass through the camera's picture; absent = through its pixels' centres.
    """
    places = (grid or PixelGrid.centers(*hits.depth.shape)).arrays
    color, known = np.zeros((*hits.depth.shape, 3), np.float32), np.zeros(hits.depth.shape, np.float32)
    if scene.patches:
        rays = [field.pose.field_from_pixel(camera) for _, field in scene.patches]
        starts, directions = (np.stack(part) for part in zip(*rays, strict=True))
        records, colors = scene.records
        shade.shade_patches(hits.depth, hits.ids, places, records, starts, directions, colors, color, known)
    for _, field, base in scene.heights:
        start, directions = field.pose.field_from_pixel(camera)
        shade.shade_heights(hits.depth, hits.ids, places, base, start, directions, field.color, color, known)
    return color, known
