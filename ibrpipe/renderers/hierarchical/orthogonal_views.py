"""Parts as max1999 keeps them: six orthogonal views, cut into slabs, of unshaded colour, depth and normal."""

from __future__ import annotations

import numpy as np

from ibrpipe.core.hierarchy import prefilter as kernels
from ibrpipe.renderers.hierarchical.nodes import Nodes
from ibrpipe.renderers.hierarchical.prefiltering import face_normals_of, is_composed
from ibrpipe.types import Array
from ibrpipe.types.prerendered import OrthogonalViews, Prerendered, view_axes

#: texels across a part, and slabs of a view (max1999, sec. 2)
RESOLUTION, SLABS = 64, 6


def orthogonal_views(nodes: Nodes, library: Prerendered) -> OrthogonalViews:
    """Draw the six views of every part of a library, one ray a texel; none of those made from copies."""
    axes, empty = view_axes(6), np.zeros((0, 3), np.float32)
    parts = []
    for name, sphere in _spheres(library):
        node = nodes.names.index(name)
        drawn = not is_composed(nodes, node)
        parts.append(_samples(*nodes.flattened(node), sphere, axes) if drawn else (empty, empty, empty))
    firsts = np.cumsum([0, *(len(part[0]) for part in parts)])
    return OrthogonalViews(
        firsts, *(np.concatenate([empty, *column]) for column in (zip(*parts) if parts else [()] * 3))
    )


def _spheres(library: Prerendered) -> list[tuple[str, Array]]:
    return list(zip(library.names, library.spheres, strict=True))


def _samples(corners: Array, paints: Array, sphere: Array, axes: Array) -> tuple[Array, Array, Array]:
    scale = max(float(paints.max(initial=0.0)), 1e-6)
    dense = np.zeros((6, SLABS, RESOLUTION, RESOLUTION, kernels.TEXEL), np.uint8)
    heights, tops = np.empty((6, SLABS, 2), np.float32), np.full(dense.shape[:4], np.nan, np.float32)
    kernels.prefilter(
        (corners - sphere[:3]).astype(np.float32), np.ascontiguousarray(paints), face_normals_of(corners), axes,
        sphere[3], 1, 1.0 / scale, 0.0, 0.0, dense, heights, tops,
    )  # fmt: skip
    view, _, v, u = np.nonzero(dense[..., 0])
    texel = dense[dense[..., 0] > 0].astype(np.float32)
    step = 2.0 * sphere[3] / RESOLUTION
    x, y = ((each + 0.5) * step - sphere[3] for each in (u, v))
    along = np.stack([x, y, tops[np.isfinite(tops)]], axis=1)
    places = sphere[:3] + np.einsum("ni,nij->nj", along, axes[view])
    normals = (texel[:, 4:7] - 128.0) / 127.0
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-6)
    return places.astype(np.float32), (scale * (texel[:, 1:4] / 255.0) ** 2).astype(np.float32), normals
