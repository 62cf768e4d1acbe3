"""Errors of an asset by texture and tile, on views that it was not made from where there are some."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ibrpipe.evaluation.held_out import load_truth
from ibrpipe.evaluation.image_scores import to_srgb8
from ibrpipe.io.documents.texture_errors import TextureErrors
from ibrpipe.io.views import View, ViewSet, spread
from ibrpipe.renderers.api import prepare, render
from ibrpipe.renderers.ldi.renderer import find_hits
from ibrpipe.renderers.scene import Scene
from ibrpipe.types import Array, Asset, Camera, LayeredDepthImage

#: tiles along the longer edge of a texture, at the most, and texels along an edge of one, at the least
TILES, LEAST = 6, 16
#: views that are measured at the most
MOST_VIEWS = 12
#: photos behind a sample that make it half sure
HALF_SURE = 2.0


@dataclass(frozen=True, eq=False)
class Tiling:
    """How the textures of an asset are cut into tiles, numbered one texture after another.

    Attributes
    ----------
    tiles : (T,) int64, texels along an edge of a tile
    shapes : (T, 2) int64, rows and columns of tiles
    firsts : (T + 1,) int64, number of each texture's first tile
    """

    tiles: Array
    shapes: Array
    firsts: Array

    @staticmethod
    def of(asset: Asset) -> Tiling:
        """Cut every texture into at most `TILES` x `TILES` tiles."""
        sizes = np.array([texture.layers.shape for texture in asset.textures], np.int64).reshape(-1, 2)
        tiles = np.maximum(LEAST, -(-sizes.max(axis=1) // TILES))
        shapes = -(-sizes // tiles[:, None])
        return Tiling(tiles, shapes, np.concatenate([[0], np.cumsum(shapes.prod(axis=1))]))

    def of_texels(self, texture: Array, row: Array, column: Array) -> Array:
        """Return the numbers (N,) of the tiles of texels."""
        edge, shape = self.tiles[texture], self.shapes[texture]
        place = np.minimum(row // edge, shape[:, 0] - 1) * shape[:, 1] + np.minimum(column // edge, shape[:, 1] - 1)
        return np.asarray(self.firsts[texture] + place)


def tiles_of_pixels(scene: Scene, camera: Camera, tiling: Tiling) -> Array:
    """Return the tile (H, W) int64 that each pixel shows; -1 = none."""
    hits = find_hits(scene, camera)
    found = np.full(hits.ids.shape, -1, np.int64)
    for number, (texture, field) in enumerate(scene.patches):
        first = int(scene.firsts[number])
        own = np.isfinite(hits.depth) & (hits.ids >= first) & (hits.ids < int(scene.firsts[number + 1]))
        column, row = np.maximum(field.cells[hits.ids[own].astype(np.int64) - first].astype(np.int64) - 1, 0).T
        found[own] = tiling.of_texels(np.full(len(row), texture), row, column)
    return found


def texture_errors(asset: Asset, views: ViewSet, observers: Sequence[Array | None]) -> list[TextureErrors]:
    """Measure the asset's textures tile by tile.

    Parameters
    ----------
    asset : Asset
    views : ViewSet
        Held-out views are measured, or training photos where there are none.
    observers : (S,) int or None of every texture
        Photos behind each sample.
    """
    tiling = Tiling.of(asset)
    sums = _measured(asset, spread(views.shown, MOST_VIEWS), tiling)
    origin = "held-out views" if views.test else "training photos"
    found = []
    for which, (texture, known) in enumerate(zip(asset.textures, observers, strict=True)):
        own = slice(int(tiling.firsts[which]), int(tiling.firsts[which + 1]))
        samples = _samples(texture.layers, known, tiling, which)
        found.append(_told(origin, sums[own], samples, int(tiling.tiles[which]), tiling.shapes[which]))
    return found


def _measured(asset: Asset, views: Sequence[View], tiling: Tiling) -> Array:
    """(tiles, 4): pixels, sum of mean squares of colour, pixels with true depth, sum of squares of depth."""
    sums = np.zeros((int(tiling.firsts[-1]), 4))
    prepared = prepare(asset.predicting(), "ldi")
    for view in views:
        truth, frame = load_truth(view), render(prepared, view.camera, outputs=("color", "depth"))
        depth = np.asarray(frame.depth)
        tiles = tiles_of_pixels(prepared.data, view.camera, tiling)
        shown = truth.mask & (tiles >= 0)
        error = (to_srgb8(np.asarray(frame.color))[shown].astype(np.float64) - truth.color[shown]) ** 2
        sums[:, 0] += np.bincount(tiles[shown], minlength=len(sums))
        sums[:, 1] += np.bincount(tiles[shown], error.mean(axis=1), len(sums))
        if truth.depth is None:
            continue
        deep = shown & np.isfinite(truth.depth) & (truth.depth > 0) & np.isfinite(depth)
        apart = (depth[deep].astype(np.float64) - truth.depth[deep]) ** 2
        sums[:, 2] += np.bincount(tiles[deep], minlength=len(sums))
        sums[:, 3] += np.bincount(tiles[deep], apart, len(sums))
    return sums


def _samples(layers: LayeredDepthImage, observers: Array | None, tiling: Tiling, which: int) -> Array:
    """(tiles, 3): samples, those that photos have seen, sum of confidence."""
    height, width = layers.shape
    texel = np.repeat(np.arange(height * width), np.diff(layers.offsets, axis=1).ravel())
    own = tiling.of_texels(np.full(len(texel), which), texel // width, texel % width) - tiling.firsts[which]
    behind = np.ones(len(texel)) if observers is None else observers.astype(np.float64)
    count = int(tiling.shapes[which].prod())
    weights = (np.ones(len(texel)), behind > 0, behind / (behind + HALF_SURE))
    return np.stack([np.bincount(own, weight, count) for weight in weights], axis=1)


def _told(origin: str, sums: Array, samples: Array, tile: int, shape: Array) -> TextureErrors:
    deep, unseen = bool(sums[:, 2].any()), bool((samples[:, 1] < samples[:, 0]).any())

    def figures(rows: Array, own: Array) -> dict[str, list[float | None]]:
        found = {"color_rms": _ratios(rows[:, 1], rows[:, 0], True)}
        found |= {"depth_rms": _ratios(rows[:, 3], rows[:, 2], True)} if deep else {}
        found |= {"coverage": _ratios(own[:, 1], own[:, 0])} if unseen else {}
        return found | {"confidence": _ratios(own[:, 2], own[:, 0])}

    whole = {name: each[0] for name, each in figures(sums.sum(axis=0)[None], samples.sum(axis=0)[None]).items()}
    known = {} if unseen or not len(samples) else {"coverage": 1.0}
    return TextureErrors.model_validate(
        {
            "measured_on": origin,
            "pixels": int(sums[:, 0].sum()),
            **known,
            **whole,
            "tile": tile,
            "rows": int(shape[0]),
            "columns": int(shape[1]),
            "tiles": figures(sums, samples),
        }
    )


def _ratios(above: Array, below: Array, root: bool = False) -> list[float | None]:
    """Return quotients, or roots of them, to two digits; None where nothing was counted."""
    return [
        float(f"{np.sqrt(one / other) if root else one / other:.2g}") if other else None
        for one, other in zip(above, below, strict=True)
    ]
