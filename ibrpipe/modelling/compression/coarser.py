"""Assets in coarser texels: samples of one surface in neighbouring texels become one, where few bytes are to do."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np

from ibrpipe.io.assets import read_asset, read_index, write_asset, write_index
from ibrpipe.modelling.compression.parts import Source
from ibrpipe.types import Array, Asset, Camera, LayeredDepthImage, ParallelFrame, Reflection, Texture, ViewDependence
from ibrpipe.types.layers import offsets_of

#: depth per coarse texel's width up to which samples are one surface, as the renderer `ldi` takes it
STEEPEST = 4.0


def coarser(asset: Asset, factor: int) -> Asset:
    """Return the asset with `factor` x `factor` texels of its layers as one; residual images stay as they are.

    Depth, colour, normal, weights and coverage are means over the samples of a surface. A surface that is in fewer than
    half of the texels that become one is left out there, so that outlines neither grow nor shrink.
    """
    return Asset(tuple(_texture(texture, factor) for texture in asset.textures), asset.info)


def write_coarser(source: Source, factor: int, folder: Path) -> Source:
    """Write the asset in coarser texels into `folder`, what components share as it is, and return it."""
    write_asset(coarser(source.asset, factor), folder)
    index = read_index(folder)
    for path in (path for shared in index.shared for path in shared.paths):
        (folder / path).unlink()
    for path in (path for shared in source.index.shared for path in shared.paths):
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(source.folder / path, folder / path)
    write_index(index.model_copy(update={"shared": source.index.shared}), folder)
    return Source(folder, read_index(folder), read_asset(folder))


def _texture(texture: Texture, factor: int) -> Texture:
    layers, group, count = joined(texture.layers, factor)
    components: list[ViewDependence] = []
    for part in texture.components:
        if isinstance(part, Reflection) and part.weights is not None:
            part = Reflection(part.light, _means(part.weights, group, count))
        components.append(part)
    return Texture(layers, tuple(components))


def joined(layers: LayeredDepthImage, factor: int) -> tuple[LayeredDepthImage, Array, int]:
    """Return coarse layers, the number (S,) of the sample that each becomes part of (-1 = none), and their count."""
    height, width = layers.shape
    shape = -(-height // factor), -(-width // factor)
    texel = np.repeat(np.arange(height * width), np.diff(layers.offsets, axis=1).ravel())
    coarse_texel = (texel // width // factor) * shape[1] + texel % width // factor
    group = _surfaces(layers, coarse_texel, factor)
    sizes = np.bincount(group)
    kept = sizes >= 0.5 * _texels(shape, (height, width), factor)[coarse_texel[np.unique(group, return_index=True)[1]]]
    number = np.where(kept, np.cumsum(kept) - 1, -1)[group]
    count = int(kept.sum())
    owner = np.zeros(count, np.int64)
    owner[number[number >= 0]] = coarse_texel[number >= 0]
    normal = _means(np.nan_to_num(layers.normal), number, count)
    size = np.linalg.norm(normal, axis=1, keepdims=True)
    found = LayeredDepthImage(
        _frame(layers.frame, factor, shape),
        offsets_of(np.bincount(owner, minlength=shape[0] * shape[1]).reshape(shape)),
        _means(layers.depth[:, None], number, count)[:, 0],
        _means(layers.color, number, count),
        np.where(size > 0, normal / np.where(size > 0, size, 1.0), np.nan).astype(np.float32),
        None if layers.observers is None else _most(layers.observers, number, count),
        None if layers.coverage is None else _means(layers.coverage[:, None], number, count)[:, 0],
    )
    return found, number, count


def _surfaces(layers: LayeredDepthImage, coarse_texel: Array, factor: int) -> Array:
    """Number the surfaces (S,) int64: samples of one coarse texel whose depths follow each other closely."""
    order = np.lexsort((layers.depth, coarse_texel))
    depth = layers.depth[order].astype(np.float64)
    if isinstance(layers.frame, Camera):
        limit = STEEPEST * factor * depth / float(min(layers.frame.K[0, 0], layers.frame.K[1, 1]))
    else:
        limit = np.full(len(depth), STEEPEST * factor * _widest(layers.frame))
    fresh = np.ones(len(order), bool)
    fresh[1:] = (np.diff(coarse_texel[order]) != 0) | (np.diff(depth) > limit[1:])
    group = np.empty(len(order), np.int64)
    group[order] = np.cumsum(fresh) - 1
    return group


def _widest(frame: ParallelFrame) -> float:
    return float(max(np.linalg.norm(frame.a), np.linalg.norm(frame.b)))


def _texels(shape: tuple[int, int], fine: tuple[int, int], factor: int) -> Array:
    """Texels that become one, of every coarse texel; fewer along the last row and column."""
    rows = np.minimum(factor, fine[0] - factor * np.arange(shape[0]))
    columns = np.minimum(factor, fine[1] - factor * np.arange(shape[1]))
    return np.outer(rows, columns).ravel()


def _frame(frame: ParallelFrame | Camera, factor: int, shape: tuple[int, int]) -> ParallelFrame | Camera:
    if isinstance(frame, Camera):
        K = np.diag([1 / factor, 1 / factor, 1.0]) @ frame.K
        return Camera(K, frame.cam_from_world, shape[1], shape[0])
    return replace(frame, a=frame.a * factor, b=frame.b * factor)


def _means(values: Array, number: Array, count: int) -> Array:
    """(count, C) float32 means of values (S, C) over the samples with each number (S,); -1 = left out."""
    own = number >= 0
    sizes = np.maximum(np.bincount(number[own], minlength=count), 1)
    columns = [np.bincount(number[own], column[own], count) / sizes for column in values.T.astype(np.float64)]
    return np.stack(columns, axis=1).astype(np.float32)


def _most(values: Array, number: Array, count: int) -> Array:
    most = np.zeros(count, np.int32)
    np.maximum.at(most, number[number >= 0], values[number >= 0])
    return most
