"""Second half of rendering a spiral texture: residuals of the four nearest directions. Source: gong-yang, sec. 5.2."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numba
import numpy as np

from ibrpipe.core.color import srgb_decode, srgb_encode
from ibrpipe.core.spiral import directions
from ibrpipe.core.spiral.lookup import shade
from ibrpipe.core.spiral.shade import add_residuals
from ibrpipe.errors import RendererError
from ibrpipe.renderers.background_compile import BackgroundCompile, Kernel
from ibrpipe.renderers.pixel_grid import PixelGrid
from ibrpipe.renderers.view_dependence.component import Picture
from ibrpipe.types import Array, Camera, SpiralResiduals, Texture

#: entries of the tables from linear light (by its square root) to display code, and back
CODES = 4096

#: what a second process compiles at the first call
BACKGROUND = BackgroundCompile(
    (
        Kernel(
            "spiral.shade", "add_residuals",
            "(float32[:,:,::1], float32[:,::1], float32[:,::1], Tuple((float64[:,::1], float64[:,::1])), "
            "float64[:,::1], Tuple((float64[:,:,::1], float64[:,::1], float64[:,::1])), "
            "Tuple((float64[::1], float64[::1], int64[::1], int64[::1])), "
            "Tuple((float64[::1], float64[::1], uint32[::1], uint32[::1], int64[::1], float64[::1])), "
            "Tuple((float64[:,::1], float64[:,::1], int64[::1], uint32[::1], float32[::1])), float32[::1], "
            "float32[::1], int64[::1])",
        ),
    )
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Tables:
    """Residuals of all textures, joined for one kernel call.

    Attributes
    ----------
    rotations, origins, scales : (T, 3, 3), (T, 3), (T, 2) float64
        Rows a, b, -f of the rectangles; their outer corners; 1 / edge lengths.
    arrays : tuple
        What :func:`ibrpipe.core.spiral.shade.add_residuals` takes as spirals, finds and tables (8-bit residuals), or
        :func:`ibrpipe.core.spiral.lookup.shade` as spirals and images (others).
    packed : bool
        Texels are 8-bit, packed into words.
    coded : bool
        Residuals are differences of display codes, else of linear light.
    encode, decode : (CODES,) float32
    """

    rotations: Array
    origins: Array
    scales: Array
    arrays: tuple[object, ...]
    packed: bool
    coded: bool
    encode: Array
    decode: Array

    @property
    def bytes(self) -> int:
        """Bytes held beyond the textures."""
        return sum(array.nbytes for array in _flat((self.rotations, self.origins, self.scales, *self.arrays)))


class SpiralDrawer:
    """The kind "spiral" as the renderers draw it."""

    def prepare(self, textures: Sequence[object]) -> Tables:
        """Join the residuals of all textures."""
        return prepare(textures)

    def add(self, tables: Tables, picture: Picture) -> Mapping[str, int]:
        """Add residuals; tell how many pixels found none."""
        lost = add(tables, picture.color, picture.depth, picture.camera, picture.known, picture.grid)
        return {"without_residual": lost}


def _flat(arrays: object) -> list[Array]:
    if isinstance(arrays, tuple):
        return [leaf for part in arrays for leaf in _flat(part)]
    return [np.asarray(arrays)]


def prepare(textures: Sequence[object]) -> Tables:
    """Join the residuals of all textures that have some.

    Raises
    ------
    RendererError
        Some textures hold 8-bit residuals and others linear ones.
    """
    found = [t.residuals for t in textures if isinstance(t, Texture) and t.residuals is not None]
    kinds = {r.texels.dtype for r in found}
    if len(kinds) > 1:
        raise RendererError("some textures hold 8-bit residuals and others linear ones; encode them alike")
    coded = kinds == {np.dtype(np.uint8)}
    if coded:
        BACKGROUND.begin()
    edges = np.array([(np.linalg.norm(r.rectangle.a), np.linalg.norm(r.rectangle.b)) for r in found])
    rotations = [
        np.stack([r.rectangle.a / a, r.rectangle.b / b, -r.rectangle.f]) for r, (a, b) in zip(found, edges, strict=True)
    ]
    code = np.arange(CODES) / (CODES - 1)
    return Tables(
        np.stack(rotations),
        np.stack([r.rectangle.origin for r in found]),
        1.0 / edges,
        _join_coded(found, 1.0 / edges) if coded else _join_linear(found),
        coded,
        coded,
        srgb_encode(code**2).astype(np.float32),
        srgb_decode(code).astype(np.float32),
    )


def _starts(members: Sequence[SpiralResiduals]) -> Array:
    """(D + 1,) int64: first texel of every image of all textures."""
    first = np.cumsum([0] + [int(r.starts[-1]) for r in members])
    return np.concatenate([*(r.starts[:-1] + first[i] for i, r in enumerate(members)), first[-1:]]).astype(np.int64)


def _join_linear(members: Sequence[SpiralResiduals]) -> tuple[object, ...]:
    counts = np.cumsum([0] + [len(r.alphas) for r in members])
    texels, end = np.empty((sum(len(r.texels) for r in members), 4), np.float32), 0
    for r in members:
        own = slice(end, end + len(r.texels))
        texels[own, :3], texels[own, 3], end = r.texels, r.valid, own.stop
    spirals = (
        np.concatenate([r.alphas for r in members]),
        np.array([r.k for r in members]),
        np.array([_limit(r) for r in members]),
        np.array([_closing(r) for r in members]),
        counts,
    )
    images = (
        np.concatenate([r.directions for r in members]),
        np.concatenate([r.sizes for r in members]).astype(np.int32),
        _starts(members),
        texels,
        np.zeros(counts[-1]),  # linear residuals have no code of nothing
    )
    return spirals, images


def _join_coded(members: Sequence[SpiralResiduals], scales: Array) -> tuple[object, ...]:
    lasts = np.cumsum([len(r.alphas) for r in members]) - 1
    parts = [_follow(r, int(last) + 1 - len(r.alphas)) for r, last in zip(members, lasts, strict=True)]
    nexts, partners, guesses = (np.concatenate([part[n] for part in parts]) for n in range(3))
    firsts = np.cumsum([0] + [len(part[2]) for part in parts])
    slopes = [r.directions[:, :2] / r.directions[:, 2:] * scale for r, scale in zip(members, scales, strict=True)]
    spirals = (
        np.array([r.k for r in members]),
        np.array([_limit(r) for r in members]),
        np.array([_closing(r) for r in members]),
        lasts,
    )
    finds = (
        np.concatenate([r.alphas for r in members]), nexts, partners, guesses, firsts,
        np.array([part[3] for part in parts]),
    )  # fmt: skip
    tables = (
        np.ascontiguousarray(np.concatenate(slopes)),
        np.concatenate([r.sizes for r in members]).astype(np.float64),
        _starts(members),
        np.concatenate([_words(r) for r in members]),
        np.array([r.zero for r in members], np.float32),
    )
    return spirals, finds, tables


def _follow(residuals: SpiralResiduals, first: int) -> tuple[Array, Array, Array, float]:
    """Return alpha of the image after each, that image, the image at the begin of every bin of alpha, bins per radian.

    Images are numbered from `first` on. After the last comes the first of the closing turn; of an open spiral, itself.
    """
    alphas, closing = np.asarray(residuals.alphas, np.float64), _closing(residuals)
    count = len(alphas)
    around = alphas[count - closing] + 2 * np.pi if closing else np.inf
    nexts = np.append(alphas[1:], around)
    partners = np.append(np.arange(1, count), count - closing if closing else count - 1)
    bins = 2.0 / np.diff(nexts[:-1], prepend=alphas[0]).min(initial=1.0)
    width = 1.0 / bins  # half of the least step: a bin holds the beginning of one image at most
    begins = width * np.arange(int(alphas[-1] * bins) + 2) - 1e-6 * width
    guesses = np.maximum(np.searchsorted(alphas, begins, side="right") - 1, 0)
    return nexts, (partners + first).astype(np.uint32), (guesses + first).astype(np.uint32), float(bins)


def _limit(residuals: SpiralResiduals) -> float:
    return directions.LIMIT if residuals.closed else np.pi / 2


def _closing(residuals: SpiralResiduals) -> int:
    return int(directions.closing_count(residuals.k)) if residuals.closed else 0


def _words(residuals: SpiralResiduals) -> Array:
    """(T,) uint32: R, G, B from the lowest byte on, and 1 in the highest where valid."""
    parts = np.zeros((len(residuals.texels), 4), np.uint8)
    parts[:, :3], parts[:, 3] = residuals.texels, residuals.valid
    return parts.view("<u4")[:, 0].astype(np.uint32, copy=False)


def add(
    tables: Tables,
    color: Array,
    depth: Array,
    camera: Camera,
    known: Array | None = None,
    grid: PixelGrid | None = None,
) -> int:
    """Add residuals to a view-independent picture in place.

    Parameters
    ----------
    color : (H, W, 3) float32, linear
    depth : (H, W) float32, along camera z; +inf where nothing is hit
    camera : Camera
    known : (H, W) float32, optional
        0 where nothing is added, because the colour is not known.
    grid : PixelGrid, optional
        Where the rays of (H, W) pass through the camera's picture; absent = through its pixels' centres.

    Returns
    -------
    int
        Pixels hit for which no residual exists.
    """
    world_from_pixel = np.ascontiguousarray(camera.world_from_pixel)
    known = np.ones_like(depth) if known is None else known
    places = (grid or PixelGrid.centers(*depth.shape)).arrays
    if not tables.packed:
        lost = np.zeros(len(depth), np.int64)
        seen = np.where(known > 0, depth, np.float32(np.inf))
        frames = tables.rotations, tables.origins, tables.scales
        shade(
            color,
            seen,
            places,
            camera.center,
            world_from_pixel,
            frames,
            *tables.arrays,
            tables.coded,
            tables.encode,
            lost,
        )
        return int(lost.sum())
    eyes = np.einsum("trc,tc->tr", tables.rotations, camera.center - tables.origins)
    lost = np.zeros(numba.get_num_threads(), np.int64)
    frames = tables.rotations @ world_from_pixel, eyes, tables.scales
    BACKGROUND.wait()
    add_residuals(
        color, depth, known, places, world_from_pixel, frames, *tables.arrays, tables.encode, tables.decode, lost
    )
    return int(lost.sum())
