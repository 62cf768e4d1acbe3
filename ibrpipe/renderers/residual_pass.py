"""Second half of rendering a spiral texture: residuals of the four nearest directions. Source: gong-yang, sec. 5.2."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ibrpipe.core import spiral
from ibrpipe.core.color import srgb_encode
from ibrpipe.core.spiral_lookup import shade
from ibrpipe.errors import RendererError
from ibrpipe.types import Array, Camera, SpiralResiduals, SpiralTexture

#: entries of the table from linear light (by its square root) to display code
CODES = 4096


@dataclass(frozen=True, eq=False)
class Tables:
    """Residuals of all textures, joined for one kernel call; `coded` = differences of display codes, else of light."""

    arrays: tuple[Array, ...]
    coded: bool
    encode: Array

    @property
    def bytes(self) -> int:
        """Bytes held beyond the textures."""
        return sum(array.nbytes for array in (*self.arrays, self.encode))


def prepare(textures: Sequence[object]) -> Tables:
    """Join the residuals of all spiral textures.

    Raises
    ------
    RendererError
        Some textures hold 8-bit residuals and others linear ones.
    """
    found = [t.residuals for t in textures if isinstance(t, SpiralTexture) and t.residuals is not None]
    kinds = {r.texels.dtype for r in found}
    if len(kinds) > 1:
        raise RendererError("some textures hold 8-bit residuals and others linear ones; encode them alike")
    encode = srgb_encode((np.arange(CODES) / (CODES - 1)) ** 2).astype(np.float32)
    return Tables(_join(found), kinds == {np.dtype(np.uint8)}, encode)


def _join(members: Sequence[SpiralResiduals]) -> tuple[Array, ...]:
    edges = [(np.linalg.norm(r.rectangle.a), np.linalg.norm(r.rectangle.b)) for r in members]
    rotations = [
        np.stack([r.rectangle.a / a, r.rectangle.b / b, -r.rectangle.f])
        for r, (a, b) in zip(members, edges, strict=True)
    ]
    counts = np.cumsum([0] + [len(r.alphas) for r in members])
    first = np.cumsum([0] + [int(r.starts[-1]) for r in members])
    starts = [r.starts[:-1] + first[i] for i, r in enumerate(members)]
    return (
        np.stack(rotations),
        np.stack([r.rectangle.origin for r in members]),
        1.0 / np.array(edges),
        np.concatenate([r.alphas for r in members]),
        np.array([r.k for r in members]),
        np.array([spiral.LIMIT if r.closed else np.pi / 2 for r in members]),
        np.array([spiral.closing_count(r.k) if r.closed else 0 for r in members]),
        counts,
        np.concatenate([r.directions for r in members]),
        np.concatenate([r.sizes for r in members]).astype(np.int32),
        np.concatenate([*starts, first[-1:]]),
        np.concatenate([_packed(r) for r in members]),
        np.concatenate([np.full(len(r.alphas), float(r.zero)) for r in members]),
    )


def _packed(residuals: SpiralResiduals) -> Array:
    """(T, 4) texels with validity as the fourth channel."""
    return np.concatenate([residuals.texels, residuals.valid[:, None].astype(residuals.texels.dtype)], axis=1)


def add(tables: Tables, color: Array, depth: Array, camera: Camera) -> int:
    """Add residuals to a view-independent picture in place.

    Parameters
    ----------
    color : (H, W, 3) float32, linear
    depth : (H, W) float32, along camera z, +inf where nothing is hit

    Returns
    -------
    int
        Pixels hit for which no residual exists.
    """
    lost = np.zeros(len(depth), np.int64)
    pose = camera.center, np.ascontiguousarray(camera.world_from_pixel)
    shade(color, depth, *pose, *tables.arrays, tables.coded, tables.encode, lost)
    return int(lost.sum())
