"""Pictures of surfaces under shared reflection: diffuse texels, tables of reflected light, and the object in itself.

The object mirrors itself once: where a reflected ray meets it again, its own colour there is seen, under the tables.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from ibrpipe.core.reflection.directions import pad
from ibrpipe.core.reflection.model import CHANNELS, predict
from ibrpipe.core.reflection.picture import ROWS, draw_gloss
from ibrpipe.errors import RendererError
from ibrpipe.renderers.background_compile import BackgroundCompile, Kernel
from ibrpipe.renderers.pixel_grid import PixelGrid
from ibrpipe.renderers.scene import SHADE_PATCHES, Scene
from ibrpipe.renderers.view_dependence.component import Picture
from ibrpipe.renderers.view_dependence.mirror import CLEAR, LIFT, Looks, Surface, look, make_surface, meet_surface
from ibrpipe.types import Array, Camera, LayeredDepthImage, Texture
from ibrpipe.types.reflection import ReflectedLight, Reflection

#: mirrored light of the object itself is cut here
BRIGHTEST = 1.5

#: what a second process compiles at the first call
BACKGROUND = BackgroundCompile(
    (
        SHADE_PATCHES,
        Kernel(
            "reflection.picture", "draw_gloss",
            "(Tuple((float32[:,::1], uint32[:,::1], float32[:,::1])), float32[:,:,::1], "
            "Tuple((float64[:,::1], float64[::1], float64[:,::1], float64[:,::1])), "
            "Tuple((int32[:,::1], float32[:,::1], float32[:,::1], float32[:,::1], boolean[::1])), "
            "Tuple((float32[:,:,::1], float64[::1])), "
            "Tuple((float64[::1], int32[:,:,::1], uint8[:,:,:,::1], float64[:,::1], int64[::1], int32[:,::1], "
            "int32[:,::1])), Tuple((float64[:,:,::1], float32[:,::1], uint8[::1])), float64[::1], int64[::1], "
            "int64[:,::1])",
        ),
    ),
    meanwhile=(Kernel("reflection.voxels", "measure_free", "(int32[:,:,::1], float64[:,::1], uint8[:,:,:,::1])"),),
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Model:
    """Shared reflection of a surface; see :mod:`ibrpipe.core.reflection.model`.

    Attributes
    ----------
    texels : (S, 3 or 3 + L) float32
        Square roots of linear diffuse light, then weights of the tables.
    tables : (L, n, n, 3) float32
        Square roots of linear reflected light.
    law : (2 + L,) float64
        Damping, Huber's bend, reflectances.
    """

    texels: Array
    tables: Array
    law: Array

    @property
    def size(self) -> int:
        """Cells along an edge of a table."""
        return int(self.tables.shape[1])

    @property
    def padded(self) -> Array:
        """(L, (n + 2)^2, 3) float32, as the kernels take the tables."""
        count, size = self.tables.shape[:2]
        return pad(self.tables).reshape(count, (size + 2) ** 2, CHANNELS)

    def colors(self, where: Array, traits: Array, corners: Array) -> Array:
        """Linear light (N, 3) float32 of looks; NaN where a patch has no known sample."""
        out = np.empty((len(where), 3), np.float32)
        predict(where, traits, corners, self.texels, self.padded, self.law, out)
        return out

    def own_light(self, where: Array, traits: Array, corners: Array) -> Array:
        """Linear light (M, 3) float32 that the object mirrors of itself; it mirrors the tables, but nothing further."""
        return np.minimum(np.nan_to_num(self.colors(where, traits, corners)), np.float32(BRIGHTEST))


def look_through(
    surface: Surface, camera: Camera, depth: Array, ids: Array, hit: Array, size: int, grid: PixelGrid | None = None
) -> Looks:
    """Look at the hits of a picture's pixels.

    Parameters
    ----------
    depth, ids : (H, W) float32 along camera z, (H, W) uint32 patches
    hit : (H, W) bool
        Pixels to look at.
    grid : PixelGrid, optional
        Where the rays of (H, W) pass through the camera's picture; absent = through its pixels' centres.
    """
    (row, column), places = np.nonzero(hit), grid or PixelGrid.centers(*hit.shape)
    rays = camera.pixel_rays(places.rows[row] + places.columns[column])
    points = camera.center + depth[hit][:, None].astype(np.float64) * rays
    return look(surface, points, ids[hit].astype(np.int64), camera.center, size)


def shade_looks(surface: Surface, model: Model, seen: Looks) -> Array:
    """Linear light (N, 3) float32 of looks, with the object's own mirror image; NaN where no colour is known."""
    if len(model.tables):
        met, ends = meet_surface(surface, seen, model.size)
        seen.traits[met, 9:] = model.own_light(ends.where, ends.traits, surface.corners)
    return model.colors(seen.where, seen.traits, surface.corners)


@dataclass(frozen=True, eq=False)
class Tables:
    """Reflection of all textures.

    Attributes
    ----------
    light : ReflectedLight
    components : tuple of Reflection or None, one per texture; None = it has none
    normals : tuple of (S, 3) float32 or None, of every texture's samples
    """

    light: ReflectedLight
    components: tuple[Reflection | None, ...]
    normals: tuple[Array | None, ...]
    made: dict[Scene, Mirrors] = field(default_factory=dict)

    @property
    def bytes(self) -> int:
        """Bytes held beyond the textures."""
        return self.light.bytes + sum(each.bytes for each in self.made.values())

    def of(self, scene: Scene) -> Mirrors:
        """Return what pictures of `scene` need, made with the first of them."""
        if scene not in self.made:
            BACKGROUND.wait()
            self.made[scene] = _mirrors(self, scene)
        return self.made[scene]


@dataclass(frozen=True, eq=False)
class Mirrors:
    """A scene's surface, and what is drawn over it.

    Attributes
    ----------
    surface : Surface
    colors : (S, 4) float32, linear; fourth 0 where the colour is not known
    weights : (S, L) float32, or (0, L): all of each table
    active : (F,) bool, layered images that mirror
    tables : (L, (n + 2)^2, 4) float32, linear light, padded; the fourth is not used
    law : (2 + L,) float64, see `Model`
    """

    surface: Surface
    colors: Array
    weights: Array
    active: Array
    tables: Array
    law: Array

    @property
    def bytes(self) -> int:
        """Bytes held."""
        surface = self.surface
        parts = (*surface.shapes, surface.records, surface.corners, surface.normals, self.weights, self.tables)
        return sum(part.nbytes for part in parts) + surface.grid.bytes

    def draw(self, picture: Picture) -> Mapping[str, int]:
        """Put gloss over a picture; tell how many pixels mirror, and how many of the rays meet it again."""
        surface, camera = self.surface, picture.camera
        view = (np.ascontiguousarray(camera.world_from_pixel), camera.center, *picture.places.arrays)
        lift = np.array([LIFT * surface.texel, CLEAR * surface.texel, BRIGHTEST])
        counts = np.zeros((len(picture.depth), 2), np.int64)
        draw_gloss(
            (picture.depth, picture.ids, picture.known), picture.color, view,
            (surface.records, surface.normals, self.colors, self.weights, self.active), (self.tables, self.law),
            surface.grid.packed, surface.shapes, lift, spread_rows(len(picture.depth)), counts,
        )  # fmt: skip
        return dict(zip(("reflecting", "met"), (int(each) for each in counts.sum(axis=0)), strict=True))


def spread_rows(height: int) -> Array:
    """Order (R,) int64 of groups of rows in which those near to each other fall to different threads."""
    return np.argsort(np.arange(-(-height // ROWS)) * 0.6180339887498949 % 1.0).astype(np.int64)


class ReflectionDrawer:
    """The kind "reflection" as the renderers draw it."""

    def prepare(self, textures: Sequence[object]) -> Tables:
        """Find the tables and components of all textures.

        Raises
        ------
        RendererError
            Textures refer to different tables, or weights are not one a sample.
        """
        parts = [each.component(Reflection.kind) if isinstance(each, Texture) else None for each in textures]
        components = tuple(part if isinstance(part, Reflection) else None for part in parts)
        lights = {id(part.light): part.light for part in components if part is not None}
        if len(lights) != 1:
            raise RendererError(f"textures refer to {len(lights)} sets of reflected light; render those of one asset")
        layers = [each.layers if isinstance(each, Texture) else each for each in textures]
        normals = tuple(each.normal if isinstance(each, LayeredDepthImage) else None for each in layers)
        for part, each in zip(components, normals, strict=True):
            if part is not None and part.weights is not None and (each is None or len(part.weights) != len(each)):
                raise RendererError(f"a reflection weighs {len(part.weights)} samples, but its texture has others")
        BACKGROUND.begin()
        return Tables(next(iter(lights.values())), components, normals)

    def add(self, tables: Tables, picture: Picture) -> Mapping[str, int]:
        """Put gloss over the diffuse colour; tell how many pixels were looked at."""
        return tables.of(picture.scene).draw(picture)


def _mirrors(tables: Tables, scene: Scene) -> Mirrors:
    """Join normals and weights of all layered images of the scene."""
    light, colors = tables.light, scene.records[1]
    count, size = light.tables.shape[:2]
    parts = [tables.components[number] for number, _ in scene.patches]
    unweighted = all(part is None or part.weights is None for part in parts)
    weights = np.zeros((0 if unweighted else len(colors), count), np.float32)
    normals, begin = np.full((len(colors), 3), np.nan, np.float32), 0
    for part, (number, image) in zip(parts, scene.patches, strict=True):
        own, normal = slice(begin, begin + len(image.color)), tables.normals[number]
        if part is not None and normal is not None:
            normals[own] = normal
            weights[own] = 1.0 if part.weights is None else part.weights
        begin = own.stop
    padded = np.zeros((count, (size + 2) ** 2, 4), np.float32)
    padded[..., :CHANNELS] = pad(light.tables).reshape(count, (size + 2) ** 2, CHANNELS)
    law = np.array([light.damping, 1.0, *light.reflectance])
    active = np.array([part is not None for part in parts])
    return Mirrors(make_surface(scene, normals), np.ascontiguousarray(colors), weights, active, padded, law)
