"""Charts: what hangs together of a layered image, as triangles between texel centres.

A chart has at most one sample a texel, so its texture coordinates are its texels: the layers' own rectangle is the
unwrapping. Where a surface ends, patches reach to the next texel centre without a sample; the alpha of the atlas cuts
them half way, where the renderers end them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from ibrpipe.renderers.fields import PatchField, Pose, build_field
from ibrpipe.types import Array, LayeredDepthImage

#: corners of a patch as two triangles; its diagonal runs from corner 1 to corner 2
_TRIANGLES = np.array([[0, 2, 1], [1, 2, 3]])


@dataclass(frozen=True, eq=False)
class Chart:
    """A piece of one layered image.

    Attributes
    ----------
    pose : Pose
        Of the image's field.
    texels : (V, 2) int32
        Column and row of every vertex in the image; -1 and one past the end where a rim reaches over it.
    vertices : (V, 3) float64, world
    faces : (F, 3) int32, counter-clockwise seen from outside
    samples : (S,) int64
        Samples of the layers in it.
    places : (S, 2) int32
        Column and row of each.
    vertex_samples : (V,) int64
        Sample at every vertex; -1 where a rim reaches over it.
    box : (4,) int
        First column, first row, columns, rows of all of its texels.
    """

    pose: Pose
    texels: Array
    vertices: Array
    faces: Array
    samples: Array
    places: Array
    vertex_samples: Array
    box: tuple[int, int, int, int]

    def place(self, points: Array) -> Array:
        """Return where world points (N, 3) lie in the image, (N, 2) float64 texels; (0, 0)'s centre is at 0."""
        field = (points - self.pose.origin) @ self.pose.linear.T + self.pose.shift
        return field[:, :2] / field[:, 3:] - 1.0

    def axis(self, points: Array) -> Array:
        """Return world directions (N, 3) along which columns grow at world points (N, 3); any length."""
        if not self.pose.perspective:
            return np.broadcast_to(np.linalg.inv(self.pose.linear[:3])[:, 0], points.shape)
        across = np.linalg.inv(self.pose.linear[[0, 1, 3]])[:, 0]
        return np.broadcast_to(across, points.shape)


def charts_of(layers: LayeredDepthImage, kept: Array) -> list[Chart]:
    """Return the charts of a layered image, those with most samples first.

    Parameters
    ----------
    layers : LayeredDepthImage
    kept : (S,) bool
        Samples that are shown; charts without any are left out.
    """
    field = build_field(layers)
    assert isinstance(field, PatchField)
    if not len(field.samples):
        return []
    rows, columns = layers.shape
    texel = np.repeat(np.arange(rows * columns), np.diff(layers.offsets, axis=1).ravel())
    label = _labels(field.samples, texel)
    owner = label[field.samples.max(axis=1)]
    order = np.argsort(owner, kind="stable")
    starts = np.searchsorted(owner[order], np.arange(label.max() + 2))
    by_label = np.argsort(label, kind="stable")
    ends = np.searchsorted(label[by_label], np.arange(label.max() + 2))
    found = []
    for number in range(label.max() + 1):
        samples = by_label[ends[number] : ends[number + 1]]
        if kept[samples].any() and starts[number] < starts[number + 1]:
            places = np.stack([texel[samples] % columns, texel[samples] // columns], axis=1)
            found.append(_chart(field, order[starts[number] : starts[number + 1]], samples, places))
    return sorted(found, key=lambda chart: -len(chart.samples))


def _labels(patches: Array, texel: Array) -> Array:
    """Number (S,) what hangs together by patches (P, 4); a second sample of a texel begins something of its own."""
    count = len(texel)
    pairs = np.concatenate([patches[:, [0, 1]], patches[:, [1, 3]], patches[:, [3, 2]], patches[:, [2, 0]]])
    pairs = pairs[(pairs >= 0).all(axis=1)]
    linked = coo_array((np.ones(len(pairs), bool), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    label = connected_components(linked, directed=False)[1].astype(np.int64)
    order = np.lexsort((np.arange(count), texel, label))
    same = np.zeros(count, np.int64)
    again = (np.diff(label[order]) == 0) & (np.diff(texel[order]) == 0)
    runs = np.arange(count) - np.maximum.accumulate(np.where(np.r_[False, again], 0, np.arange(count)))
    same[order] = runs
    _, found = np.unique(label * (same.max() + 1) + same, return_inverse=True)
    return found.reshape(-1)


def _chart(field: PatchField, patches: Array, samples: Array, places: Array) -> Chart:
    corners = field.cells[patches][:, None, :] + np.array([(-1, -1), (0, -1), (-1, 0), (0, 0)])
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    width = int(high[0] - low[0] + 1)
    key = (corners[..., 1] - low[1]) * width + corners[..., 0] - low[0]
    used, vertex = np.unique(key, return_inverse=True)
    vertex = vertex.reshape(-1, 4)
    depth = np.bincount(vertex.ravel(), field.corners[patches].ravel().astype(np.float64)) / np.bincount(vertex.ravel())
    texels = np.stack([used % width + low[0], used // width + low[1]], axis=1)
    vertices = _world(field.pose, texels, depth)
    faces = vertex[:, _TRIANGLES].reshape(-1, 3)
    if _clockwise(field.pose):
        faces = faces[:, ::-1]
    box = (int(low[0]), int(low[1]), width, int(high[1] - low[1] + 1))
    held = np.full(len(used), -1, np.int64)
    own = (places[:, 1] - low[1]) * width + places[:, 0] - low[0]
    held[np.searchsorted(used, own)] = samples
    return Chart(
        field.pose,
        texels.astype(np.int32),
        vertices,
        faces.astype(np.int32),
        samples,
        places.astype(np.int32),
        held,
        box,
    )


def _world(pose: Pose, texels: Array, depth: Array) -> Array:
    """World positions (V, 3) of texel centres (V, 2) at field depths (V,)."""
    if pose.perspective:
        rays = np.column_stack([texels + 1.0, np.ones(len(texels))])
        return pose.origin + rays @ np.linalg.inv(pose.linear[[0, 1, 3]]).T * (-1.0 / depth)[:, None]
    field = np.column_stack([texels + 1.0, depth])
    return pose.origin + (field - pose.shift[:3]) @ np.linalg.inv(pose.linear[:3]).T


def _clockwise(pose: Pose) -> bool:
    """Say whether `_TRIANGLES` wind clockwise seen from where depth is counted."""
    return bool(np.linalg.det(pose.linear[[0, 1, 3] if pose.perspective else [0, 1, 2]]) < 0)
