"""Depth maps that confirm each other: points with normals, and depth maps cleaned for the volume."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np

from ibrpipe.core.reconstruction.fusion import fuse_view
from ibrpipe.io.dense import DepthMap
from ibrpipe.progress import Step
from ibrpipe.reconstruction.depth.map_store import LoadedMap, MapCache, MapStore, Packed, pack
from ibrpipe.types import Array

FUSE = Step("fuse depth maps", 0.45)
#: bytes of a point of a cloud
POINT_BYTES = 48


@dataclass(frozen=True)
class FusionRules:
    """When depth of two views counts as the same surface.

    Attributes
    ----------
    pixels : float
        Most disparity between both, in pixels of the neighbour.
    relative : float
        Most difference of depth, as a share of it.
    degrees : float
        Most angle between the normals.
    votes : int
        Views that must agree, the view itself included.
    """

    pixels: float = 1.0
    relative: float = 0.01
    degrees: float = 35.0
    votes: int = 2

    def packed(self) -> Array:
        """Settings as the kernel reads them."""
        return np.array([self.pixels, self.relative, np.cos(np.radians(self.degrees)), self.votes], np.float64)


@dataclass(frozen=True, eq=False)
class Cloud:
    """Points that depth maps agree on.

    Attributes
    ----------
    position : (N, 3) float64
    normal : (N, 3) float32
    confidence : (N,) float32
    votes : (N,) int32
        Depth maps that make up the point.
    spacing : (N,) float32
        Size of the pixel it comes from on the surface, scene units.
    """

    position: Array
    normal: Array
    confidence: Array
    votes: Array
    spacing: Array

    def every(self, stride: int) -> Cloud:
        """Return every so manieth point."""
        return self if stride == 1 else self.chosen(np.arange(0, len(self.position), stride))

    def chosen(self, index: Array) -> Cloud:
        """Return some of the points, by number or by a mask."""
        return Cloud(*(getattr(self, each.name)[index] for each in fields(self)))


@dataclass(frozen=True, eq=False)
class Fused:
    """What agrees.

    Attributes
    ----------
    maps : MapStore
        The given maps with only confirmed pixels, at mean depth and normal.
    cloud : Cloud
        Every confirmed place once.
    known, confirmed : int
        Pixels with depth before and after.
    masked : int
        Pixels inside the masks.
    """

    maps: MapStore
    cloud: Cloud
    known: int
    confirmed: int
    masked: int


def fuse(maps: Sequence[DepthMap], rules: FusionRules, scratch: Path, memory: int = 400_000_000) -> Fused:
    """Confirm the maps by each other, view after view.

    Parameters
    ----------
    maps : sequence of DepthMap
        Their `neighbours` are asked; a map without any asks all others whose centres are nearest.
    rules : FusionRules
    scratch : Path
        Folder for the confirmed maps.
    memory : int
        Bytes that loaded maps may take, and again that the points may take: beyond that every second point is left out.
    """
    cache, rule = MapCache(maps, memory), rules.packed()
    used: dict[str, Array] = {}
    store = MapStore(scratch)
    clouds: list[Cloud] = []
    counts, stride = np.zeros(3, np.int64), 1
    for given in FUSE.track(maps):
        own = cache.get(given.view.name)
        others = [cache.get(name) for name in neighbours_of(given, maps)]
        packed = pack([own, *others])
        taken = [used.setdefault(each.name, np.zeros(each.depth.size, np.uint8)) for each in (own, *others)]
        marks = np.concatenate(taken)
        mean, normal, votes = _judged(packed, rule, marks, own.depth.shape)
        for each, start, end in zip((own, *others), packed.starts[:-1], packed.starts[1:]):
            used[each.name] = marks[start:end].copy()
        kept = (votes[..., 0] >= rules.votes) & (votes[..., 0] > votes[..., 1])
        clouds.append(_cloud(own, mean, normal, votes, kept & (used[own.name].reshape(kept.shape) == 0)).every(stride))
        while len(clouds) > 1 and sum(len(each.position) for each in clouds) * POINT_BYTES > memory:
            clouds, stride = [each.every(2) for each in clouds], 2 * stride
        store.put(replace(own, depth=mean[..., 0] * kept, normal=normal, confidence=mean[..., 1] * kept))
        counts += (int((own.depth > 0).sum()), int(kept.sum()), int((own.mask >= 0.5).sum()))
    return Fused(store, joined(clouds), int(counts[0]), int(counts[1]), int(counts[2]))


def neighbours_of(given: DepthMap, maps: Sequence[DepthMap], most: int = 12) -> list[str]:
    """Return the views to ask about a map: those it was matched with, else the nearest ones that look its way."""
    names = {each.view.name for each in maps}
    own = [name for name in given.neighbours if name in names and name != given.view.name]
    if own:
        return own[:most]
    rest = [each.view for each in maps if each.view.name != given.view.name]
    here = given.view.camera
    along = [float(view.camera.R[2] @ here.R[2]) for view in rest]
    apart = [float(np.linalg.norm(view.camera.center - here.center)) for view in rest]
    order = sorted((index for index in range(len(rest)) if along[index] > 0.3), key=lambda index: apart[index])
    return [rest[index].name for index in order[:most]]


def _judged(packed: Packed, rule: Array, marks: Array, shape: tuple[int, ...]) -> tuple[Array, Array, Array]:
    mean, normal = np.empty((*shape, 2), np.float32), np.empty((*shape, 3), np.float32)
    votes = np.empty((*shape, 2), np.int32)
    fuse_view(packed.depth, packed.normal, packed.confidence, packed.cameras, rule, marks, mean, normal, votes)
    return mean, normal, votes


def _cloud(own: LoadedMap, mean: Array, normal: Array, votes: Array, chosen: Array) -> Cloud:
    row, column = np.nonzero(chosen)
    rays, z = own.camera.pixel_rays(np.stack([column, row], axis=1) + 0.5), mean[row, column, 0].astype(np.float64)
    flat = np.abs((rays / np.linalg.norm(rays, axis=1, keepdims=True) * normal[row, column]).sum(axis=1))
    spacing = z / own.camera.K[0, 0] / np.sqrt(np.maximum(flat, 0.1))
    return Cloud(
        own.camera.center + z[:, None] * rays,
        normal[row, column],
        mean[row, column, 1],
        votes[row, column, 0],
        spacing.astype(np.float32),
    )


def joined(clouds: Sequence[Cloud]) -> Cloud:
    """Put clouds together."""
    if not clouds:
        none = np.zeros(0, np.float32)
        return Cloud(np.zeros((0, 3)), np.zeros((0, 3), np.float32), none, np.zeros(0, np.int32), none)
    return Cloud(*(np.concatenate([getattr(cloud, each.name) for cloud in clouds]) for each in fields(Cloud)))
