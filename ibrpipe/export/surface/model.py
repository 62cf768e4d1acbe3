"""An asset as one mesh and its pictures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ibrpipe.export.surface.atlas import Atlas, color_picture
from ibrpipe.export.surface.charts import Chart, charts_of
from ibrpipe.export.surface.colors import mean_colors
from ibrpipe.export.surface.decimate import decimate
from ibrpipe.progress import track
from ibrpipe.types import Array, Asset, Camera, LayeredDepthImage, Texture
from ibrpipe.types.bounds import sample_positions
from ibrpipe.types.layers import pitch_of
from ibrpipe.types.reflection import Reflection


@dataclass(frozen=True, eq=False)
class SurfaceModel:
    """A mesh with one atlas; world coordinates, scene units.

    Attributes
    ----------
    vertices : (V, 3) float64
    faces : (F, 3) int32, counter-clockwise seen from outside
    uv : (V, 2) float64, 0 to 1, v downward
    normals : (V, 3) float64, unit
    tangents : (V, 3) float64, unit, at right angles to the normals, along growing u; v grows against
        ``cross(normals, tangents)``
    color : (h, w, 4) uint8, sRGB, alpha 255 where there is surface
    normal_picture : (h, w, 3) float32, unit, world; 0 where there is none
    gloss : (h, w) float32 or None
        How much of the first table of reflected light is shown.
    """

    vertices: Array
    faces: Array
    uv: Array
    normals: Array
    tangents: Array
    color: Array
    normal_picture: Array
    gloss: Array | None = None

    def told(self) -> str:
        """Return the sizes as a clause."""
        height, width = self.color.shape[:2]
        return f"{len(self.faces)} triangles, {width} x {height} texels"


def build_model(asset: Asset, cameras: Sequence[Camera], tolerance: float, diffuse: bool = False) -> SurfaceModel:
    """Return an asset as one mesh with an atlas whose texels are the asset's own.

    Parameters
    ----------
    asset : Asset
        Some of its samples are seen by a photo.
    cameras : sequence of Camera
        Those of the photos; empty = unknown.
    tolerance : float
        How far the surface may move while triangles are joined, texels.
    diffuse : bool
        Colours without what the object mirrors, instead of their mean over the views.
    """
    charts: list[Chart] = []
    values: list[tuple[Texture, Array, Array]] = []
    pitches: list[float] = []
    for texture in asset.textures:
        shown = shown_samples(texture.layers)
        colors = texture.layers.color if diffuse else mean_colors(texture, sample_positions(texture.layers), cameras)
        own = charts_of(texture.layers, shown)
        charts += own
        values += [(texture, colors, shown)] * len(own)
        pitches += [pitch_of(texture.layers)] * len(own)
    atlas = Atlas(charts)
    color = color_picture(
        atlas,
        [colors[chart.samples] for chart, (_, colors, _) in zip(charts, values)],
        [np.where(shown[chart.samples], 255, 0).astype(np.uint8) for chart, (_, _, shown) in zip(charts, values)],
    )
    normal_picture = atlas.spread([_normals(each[0].layers)[chart.samples] for chart, each in zip(charts, values)])[0]
    gloss = _gloss(atlas, charts, values)
    pieces = [
        _piece(atlas, index, chart, tolerance, pitch)
        for index, (chart, pitch) in enumerate(track(list(zip(charts, pitches)), "mesh"))
    ]
    starts = np.cumsum([0, *(len(each[0]) for each in pieces)])
    vertices, uv, along = (np.concatenate([each[part] for each in pieces]) for part in (0, 2, 3))
    faces = np.concatenate([each[1] + start for each, start in zip(pieces, starts)]).astype(np.int32)
    normals = _vertex_normals(vertices, faces, uv, normal_picture)
    along = along - (along * normals).sum(axis=1, keepdims=True) * normals
    tangents = along / np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-300)
    return SurfaceModel(vertices, faces, uv, normals, tangents, color, normal_picture, gloss)


def shown_samples(layers: LayeredDepthImage) -> Array:
    """(S,) bool: samples that some photo sees and that fill at least half of their texel."""
    shown = np.ones(len(layers.depth), bool) if layers.observers is None else layers.observers > 0
    return shown if layers.coverage is None else shown & (layers.coverage >= 0.5)


def _piece(atlas: Atlas, index: int, chart: Chart, tolerance: float, pitch: float) -> tuple[Array, ...]:
    """Vertices, faces, texture coordinates and directions of growing u of one chart."""
    vertices, faces = decimate(chart.vertices, chart.faces, tolerance, pitch)
    left, top, columns, rows = chart.box
    texels = np.clip(chart.place(vertices), (left - 1, top - 1), (left + columns, top + rows))
    return vertices, faces, atlas.coordinates(index, texels), chart.axis(vertices)


def _normals(layers: LayeredDepthImage) -> Array:
    """(S, 3) float32 unit normals, 0 where unknown."""
    return np.where(np.isfinite(layers.normal).all(axis=1, keepdims=True), layers.normal, 0.0).astype(np.float32)


def _vertex_normals(vertices: Array, faces: Array, uv: Array, picture: Array) -> Array:
    """(V, 3) unit normals: the samples' own, else those of the faces around."""
    height, width = picture.shape[:2]
    column = np.clip((uv[:, 0] * width).astype(np.int64), 0, width - 1)
    row = np.clip((uv[:, 1] * height).astype(np.int64), 0, height - 1)
    own = picture[row, column].astype(np.float64)
    flat = np.cross(vertices[faces[:, 1]] - vertices[faces[:, 0]], vertices[faces[:, 2]] - vertices[faces[:, 0]])
    around = np.stack(
        [np.bincount(faces.ravel(), np.repeat(flat[:, axis], 3), len(vertices)) for axis in range(3)], axis=1
    )
    around = around / np.maximum(np.linalg.norm(around, axis=1, keepdims=True), 1e-300)
    found = np.where((own * around).sum(axis=1, keepdims=True) > 0.2, own, around)
    lengths = np.linalg.norm(found, axis=1, keepdims=True)
    return np.where(lengths > 0, found / np.maximum(lengths, 1e-300), (0.0, 0.0, 1.0))


def _gloss(atlas: Atlas, charts: Sequence[Chart], values: Sequence[tuple[Texture, Array, Array]]) -> Array | None:
    """(h, w) float32 weights of the first table; None where nothing is mirrored, or all of it everywhere."""
    parts = []
    for chart, (texture, _, _) in zip(charts, values):
        found = texture.component(Reflection.kind)
        weights = found.weights if isinstance(found, Reflection) else np.zeros((len(texture.layers.depth), 1))
        parts.append(np.ones((len(chart.samples), 1)) if weights is None else weights[chart.samples, :1])
    if all((part == 1).all() for part in parts):
        return None
    picture = atlas.spread([part.astype(np.float32) for part in parts])[0][..., 0]
    return picture if picture.any() else None
