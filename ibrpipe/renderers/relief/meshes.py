"""Relief-mapped meshes as the `relief` renderer prepares and draws them."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from ibrpipe.core.normals import incidence, weld
from ibrpipe.core.relief_mesh import hit, raster, shade
from ibrpipe.core.relief_mesh import shell as relief_mesh_shell
from ibrpipe.core.relief_mesh.frames import FACE_SIZE, corner_frames, face_axes
from ibrpipe.core.relief_mesh.map import build_bounds, pad_layer, plan_levels, shift_of, slopes
from ibrpipe.core.relief_mesh.mips import build_mips, halve_axis
from ibrpipe.core.relief_mesh.tree import find_walls, fit_boxes, sort_faces
from ibrpipe.errors import RendererError, ShapeError
from ibrpipe.io.surfaces.materials import texture_size
from ibrpipe.renderers.background_compile import BackgroundCompile, Kernel
from ibrpipe.renderers.levels import COARSEST
from ibrpipe.renderers.relief.options import ReliefOptions
from ibrpipe.types import Array, Camera
from ibrpipe.types.relief_mesh import ReliefMesh

#: faces around a vertex that bend more than this do not share a normal
CREASE = math.cos(math.radians(40.0))
#: sheets of polygons that are looked through, one behind the other, at most
SHEETS = 32
#: steps along the normal where the options do not say
MESH_STEPS = 10
MAPPINGS = {"plain": 0.0, "bump": 1.0, "parallax": 2.0, "relief": 3.0}

_LAYERS = "Tuple((float32[:,::1], float32[:,::1], float32[::1], float32[::1], int64[::1]))"
_MIPS = "Tuple((float32[:,::1], int64[:,::1]))"
#: what a second process compiles at the first call
BACKGROUND = BackgroundCompile(
    (
        Kernel(
            "relief_mesh.raster", "draw_faces",
            "(float64[:,::1], int64[:,::1], int32[:,::1], float64[:,::1], float64[:,::1], float32[:,::1], "
            "float64[:,::1], int32[:,::1])",
        ),
        Kernel(
            "relief_mesh.shade", "shade_hits",
            f"(uint8[:,::1], float32[:,::1], float64[:,:,::1], float32[:,:,::1], {_LAYERS}, float64[::1], "
            f"float64[::1], float64[:,::1], {_MIPS}, {_MIPS}, float32[:,:,::1], float32[:,::1])",
        ),
    ),
    meanwhile=(
        Kernel(
            "relief_mesh.hit", "hit_faces",
            f"(Tuple((float64[:,::1], int64[:,::1], float64[:,:,::1], float32[:,:,::1])), {_LAYERS}, float64[::1], "
            "float64[:,::1], float64[:,::1], int32[:,::1], float32[:,::1], uint8[:,::1], float64[:,:,::1], "
            "float32[:,:,::1])",
        ),
        Kernel(
            "relief_mesh.raster", "bound_faces",
            "(float64[:,::1], int64[:,::1], float64[:,::1], boolean, int64, int64, int32[:,::1])",
        ),
    ),
)  # fmt: skip


def pack_lamp(options: ReliefOptions, eye: Array, slopes: bool) -> Array:
    """Return the lamp as :mod:`ibrpipe.core.relief_mesh.shade` wants it; `slopes`: normals come from the heights."""
    core = shade
    lamp = np.zeros(core.LAMPS)
    lamp[core.PROBES], lamp[core.SLOPES] = options.anisotropy, slopes
    if options.light is None:
        return lamp
    light = np.array(options.light)
    lamp[core.LIT], lamp[core.IS_POINT] = 1.0, 1.0 if light.size == 3 or light[3] != 0.0 else 0.0
    lamp[core.TOWARD : core.TOWARD + 3] = light[:3] - (eye if lamp[core.IS_POINT] else 0.0)
    shares = ((core.AMBIENT, options.ambient), (core.DIFFUSE, options.diffuse), (core.SPECULAR, options.specular))
    for slot, share in shares:
        lamp[slot : slot + 3] = share
    lamp[core.SHININESS], lamp[core.SHADOWS] = options.shininess, options.shadows
    lamp[core.BIAS] = 1e-4 if options.search == "exact" else 0.05
    return lamp


@dataclass(frozen=True, eq=False)
class MeshPart:
    """A relief-mapped mesh with its pyramids.

    Attributes
    ----------
    source : ReliefMesh
    first : (U,) int64
        A vertex of the source for each vertex that is left when those at one point are one.
    corners : (F, 3) int64, numbers of those
    around : (starts, faces), CSR of the faces around each of them
    order : (F,) int64, the faces along a curve through space, for the shell's tree
    walls : (F, 3) uint8, sides of the shell's prisms where it ends or its texture does not go on
    layers : front, back, lows, highs, plan of :mod:`ibrpipe.core.relief_mesh.map`
    colors, normals : texels and table of :mod:`ibrpipe.core.relief_mesh.mips`
    """

    source: ReliefMesh
    first: Array
    corners: Array
    around: tuple[Array, Array]
    order: Array
    walls: Array
    layers: tuple[Array, Array, Array, Array, Array]
    colors: tuple[Array, Array]
    normals: tuple[Array, Array]

    def level(self, number: int) -> MeshPart:
        """The same with heights of a level of their mip maps; colours and normals have their own."""
        return self if number <= 0 or max(self.source.height.shape) < 2 else self.half.level(number - 1)

    @cached_property
    def half(self) -> MeshPart:
        """The same with the heights of the next level; slopes stay those of all heights, with their own levels."""
        back = None if self.source.back is None else _halved(self.source.back)
        source = replace(self.source, height=_halved(self.source.height), back=back)
        return replace(self, source=source, layers=_layers_of(source))

    def suited_level(self, camera: Camera) -> int:
        """Level at which a texel is about a pixel on the nearest vertex before the eye."""
        depth = self.source.mesh.vertices @ camera.R[2] + camera.t[2]
        if not (depth > 0).all():
            return 0
        texel = texture_size(self.source.mesh, self.source.uv) / max(self.source.height.shape)
        pixels = float(max(camera.K[0, 0], camera.K[1, 1])) * texel / float(depth.min())
        return int(min(max(math.floor(-math.log2(max(pixels, 1e-9))), 0), COARSEST))

    @property
    def bytes(self) -> int:
        """Bytes held beyond the source itself."""
        below = self.half.bytes + self.half.source.height.nbytes if "half" in self.__dict__ else 0
        arrays = (
            self.first,
            self.corners,
            *self.around,
            self.order,
            self.walls,
            *self.layers,
            *self.colors,
            *self.normals,
        )
        return below + sum(array.nbytes for array in arrays)

    def local_vertices(self, eye: Array, vertices: Array | None = None) -> Array:
        """Return the vertices (V, 3) counted from the eye; `vertices`, finite, replaces those of the source.

        Raises
        ------
        ShapeError
            `vertices` are not as many as the source's.
        """
        own = self.source.mesh.vertices
        moved = own if vertices is None else vertices
        if moved.shape != own.shape:
            raise ShapeError(f"vertices must be {own.shape} as in the source, got {moved.shape}")
        return np.ascontiguousarray(moved[self.first] - eye)

    def frames(self, local: Array, smooth: bool = False) -> Array:
        """(F, 3, 9) float32 normal and texture axes of every corner; smooth: normals heed no crease."""
        axes, frames = np.empty((len(self.corners), FACE_SIZE)), np.empty((len(self.corners), 3, 9), np.float32)
        face_axes(local, self.corners, self.source.uv, axes)
        corner_frames(self.corners, self.source.uv, *self.around, axes, CREASE, smooth, frames)
        return frames

    def rule(self, options: ReliefOptions) -> Array:
        """Return the rule as :mod:`ibrpipe.core.relief_mesh.hit` wants it."""
        core, (rows, columns) = hit, self.source.height.shape
        rule = np.zeros(core.RULES)
        rule[core.ACROSS], rule[core.DOWN] = columns, rows
        rule[core.SHIFT], rule[core.DEEP] = shift_of(self.source.edges == "wrap"), self.source.thickness
        rule[core.MAPPING], rule[core.EXACT] = MAPPINGS[options.mapping], options.search == "exact"
        rule[core.STEPS], rule[core.BISECTION_STEPS] = options.linear_steps, options.binary_steps
        rule[core.LEAST] = MESH_STEPS if options.least_steps is None else options.least_steps
        return rule

    def draw(
        self,
        camera: Camera,
        options: ReliefOptions,
        depth: Array,
        color: Array | None,
        alpha: Array | None,
    ) -> int:
        """Lower `depth` (h, w) float32 where this mesh is nearer, colour what is hit; count the sheets looked at."""
        size, some = depth.shape, color is not None
        buffers = (
            np.zeros(size, np.uint8),
            *(np.empty((*size, k), t) if some else np.empty((0, 0, k), t) for k, t in _HIT_ARRAYS),
        )
        local = self.local_vertices(camera.center, options.vertices)
        world_from_pixel, rule = camera.world_from_pixel, self.rule(options)
        search = self._search_shell if options.model == "shell" else self._search_sheets
        sheets = search(local, camera, options, rule, depth, buffers)
        if color is not None and alpha is not None:
            mine, relief_points, tangent_frames = buffers
            lamp = pack_lamp(options, camera.center, self.source.normal is None)
            BACKGROUND.wait()
            shade.shade_hits(
                mine,
                depth,
                relief_points,
                tangent_frames,
                self.layers,
                rule,
                lamp,
                world_from_pixel,
                self.colors,
                self.normals,
                color,
                alpha,
            )
        return sheets

    def _search_sheets(
        self, local: Array, camera: Camera, options: ReliefOptions, rule: Array, depth: Array, buffers: Any
    ) -> int:
        """Search below the nearest polygon of each pixel, then below those behind it that are nearer than the hit."""
        source, size = self.source, depth.shape
        frames = self.frames(local)
        moved = options.vertices is not None
        if not moved and source.normals is not None:
            frames[:, :, :3] = source.normals
        if not moved and source.tangents is not None:
            _take_tangents(frames, source.tangents)
        mesh, world_from_pixel = (local, self.corners, source.uv, frames), camera.world_from_pixel
        BACKGROUND.wait()
        bounds = np.empty((len(self.corners), 4), np.int32)
        raster.bound_faces(local, self.corners, camera.K @ camera.R, options.two_sided, size[1], size[0], bounds)
        after, layer, face = np.zeros(size), np.empty(size), np.empty(size, np.int32)
        sheets = 0
        while sheets < SHEETS and raster.draw_faces(
            local, self.corners, bounds, world_from_pixel, after, depth, layer, face
        ):
            hit.hit_faces(mesh, self.layers, rule, world_from_pixel, layer, face, depth, *buffers)
            after, layer = layer, after
            sheets += 1
        return sheets

    def _search_shell(
        self, local: Array, camera: Camera, options: ReliefOptions, rule: Array, depth: Array, buffers: Any
    ) -> int:
        """Search the prisms below all polygons along every ray."""
        normals = np.empty((len(local), 3))
        normals[self.corners] = self.frames(local, smooth=True)[:, :, :3]
        boxes = fit_boxes(local, normals, self.corners, self.source.thickness, self.order)
        shell = (local, normals, self.corners, self.source.uv, self.walls)
        relief_mesh_shell.hit_shell(
            shell, self.layers, rule, camera.world_from_pixel, self.order, boxes, depth, *buffers
        )
        return 1


_HIT_ARRAYS = ((3, np.float64), (9, np.float32))


def _take_tangents(frames: Array, tangents: Array) -> None:
    """Turn the texture axes to given directions of u; their lengths and which way round they run stay."""
    normal, along, across = (frames[:, :, 3 * k : 3 * k + 3].astype(np.float64) for k in range(3))
    flat = tangents - (tangents * normal).sum(-1, keepdims=True) * normal
    length = np.linalg.norm(flat, axis=-1, keepdims=True)
    unit = flat / np.where(length > 1e-12, length, 1.0)
    hand = np.sign((np.cross(normal, along) * across).sum(-1, keepdims=True))
    turned = np.concatenate(
        [
            unit * np.linalg.norm(along, axis=-1, keepdims=True),
            hand * np.cross(normal, unit) * np.linalg.norm(across, axis=-1, keepdims=True),
        ],
        axis=-1,
    )
    frames[:, :, 3:] = np.where(length > 1e-12, turned, frames[:, :, 3:])


def build_mesh(source: ReliefMesh) -> MeshPart:
    """Build pyramids, mip maps and neighbourhoods of a relief-mapped mesh.

    Raises
    ------
    RendererError
        The relief is too large.
    """
    if max(source.height.shape) > 2**15:
        raise RendererError(f"a relief of {source.height.shape} texels is too large; at most 32768 on a side")
    BACKGROUND.begin()
    wraps = source.edges == "wrap"
    number = weld(source.mesh.vertices)
    _, first = np.unique(number, return_index=True)
    order = np.argsort(first)  # as in the source: the shell's diagonals go by it
    corners = np.ascontiguousarray(np.argsort(order)[number][source.mesh.faces], np.int64)
    first = first[order]
    color = np.ones((1, 1, 3)) if source.color is None else source.color
    normal = slopes(source.height, wraps) if source.normal is None else source.normal
    return MeshPart(
        source,
        first.astype(np.int64),
        corners,
        incidence(corners, len(first)),
        sort_faces(source.mesh.vertices[first], corners),
        find_walls(corners, source.uv),
        _layers_of(source),
        build_mips(_four(color)),
        build_mips(_four(normal)),
    )


def _layers_of(source: ReliefMesh) -> tuple[Array, Array, Array, Array, Array]:
    """Depths of front and back, their bounds, and the plan of these."""
    wraps = source.edges == "wrap"
    front = pad_layer(1.0 - source.height, wraps)
    plan = plan_levels(front.shape[0] - 1, front.shape[1] - 1, wraps)
    back, highs = np.empty((0, 0), np.float32), np.empty(0, np.float32)
    if source.back is not None:
        back = pad_layer(1.0 - source.back, wraps)
        highs = build_bounds(back, plan, False)
    return front, back, build_bounds(front, plan, True), highs, plan


def _halved(heights: Array) -> Array:
    return np.clip(halve_axis(halve_axis(heights.astype(np.float64), 0), 1), 0.0, 1.0).astype(np.float32)


def _four(picture: Array) -> Array:
    return np.concatenate([picture, np.ones((*picture.shape[:2], 1))], axis=2)
