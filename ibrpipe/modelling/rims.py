"""How much of their texels surfaces fill: texels at rims and of thin things are looked at through 3 x 3 places.

A texel's middle tells only whether a surface is met there, so an edge stands up to half a texel off, and a wire of one
texel comes and goes. With its coverage a rim sample keeps place and width, and the renderer shows it as far as it fills
its texel, before what is behind it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ibrpipe.core.rims import ALONG, group_hits
from ibrpipe.embree import MeshCaster
from ibrpipe.modelling.rectangles import Rectangle
from ibrpipe.types import Array

#: distance from a tangent plane within which hits of one texel are one surface, texels
GAP = 1.0
#: texels that are looked at closely together
BAND = 100_000
#: shares of a texel that its places stand for: those on its border belong to its neighbours, too
SHARES = np.outer([0.25, 0.5, 0.25], [0.25, 0.5, 0.25]).ravel()
_AROUND = ((0, -1), (0, 1), (-1, 0), (1, 0), (-1, -1), (-1, 1), (1, -1), (1, 1))


@dataclass(frozen=True, eq=False)
class Fronts:
    """What the rays of a rectangle meet of surfaces that face it, by texel, then by depth.

    Attributes
    ----------
    ray : (N,) int64, texel
    depth : (N,) float32, in the middle of the texel
    points, normals : (N, 3) float64, float32, world; a rim's point is where a ray meets it
    face : (N,) int32
    coverage : (N,) float32, share of the texel that it fills
    """

    ray: Array
    depth: Array
    points: Array
    normals: Array
    face: Array
    coverage: Array

    def __getitem__(self, chosen: Array) -> Fronts:
        """Some of them."""
        parts = (self.ray, self.depth, self.points, self.normals, self.face, self.coverage)
        return Fronts(*(part[chosen] for part in parts))


def meet_fronts(rectangle: Rectangle, caster: MeshCaster, texels: Array | None = None) -> Fronts:
    """Meet surfaces that face a rectangle by rays through the middles of texels (T,), or all; each fills its texel."""
    wanted = np.arange(rectangle.width * rectangle.height) if texels is None else texels
    column, row = wanted % rectangle.width, wanted // rectangle.width
    origins, directions = rectangle.rays_at(column + 0.5, row + 0.5)
    return _met(caster, origins, directions, wanted)


def _met(caster: MeshCaster, origins: Array, directions: Array, texels: Array) -> Fronts:
    ray, hits = caster.cast_all(origins, directions)
    front = np.flatnonzero((hits.t > 0) & ((hits.normal * directions[ray]).sum(axis=1) < 0))
    ray, t, face = ray[front], hits.t[front], hits.face[front]
    points = origins[ray] + t[:, None].astype(np.float64) * directions[ray]
    normals = caster.smooth_normals(face, hits.uv[front])
    return Fronts(texels[ray], t, points, normals, face, np.ones(len(ray), np.float32))


def with_rims(fronts: Fronts, rectangle: Rectangle, caster: MeshCaster) -> Fronts:
    """Look closely at texels where a surface ends, and beside them; what they hold replaces what their middles met.

    Where a texel is found to be filled in part those around it are looked at, too: so thin things are followed on
    where no middle meets them.
    """
    shape = rectangle.height, rectangle.width
    ends = ~has_partner(fronts, fronts, rectangle).all(axis=1)
    looked, parts = np.zeros(shape, bool), list[Fronts]()
    wanted = _around(_marked(fronts.ray[ends], shape))
    while wanted.any():
        looked |= wanted
        texels = np.flatnonzero(wanted.ravel())
        found = [look_closely(texels[i : i + BAND], rectangle, caster) for i in range(0, len(texels), BAND)]
        partly = np.concatenate([part.ray[part.coverage < 1] for part in found])
        wanted = _around(_marked(partly, shape)) & ~looked
        parts += found
    parts.append(fronts[~looked.ravel()[fronts.ray]])
    found_all = Fronts(*(np.concatenate([getattr(part, name) for part in parts]) for name in (
        "ray", "depth", "points", "normals", "face", "coverage")))  # fmt: skip
    return found_all[np.lexsort((found_all.depth, found_all.ray))]


def _marked(texels: Array, shape: tuple[int, int]) -> Array:
    marked = np.zeros(shape, bool)
    marked.ravel()[texels] = True
    return marked


def _around(marked: Array) -> Array:
    """Texels (H, W) bool that are marked, and those around them."""
    wide = np.pad(marked, 1)
    wide = wide[:-2] | wide[1:-1] | wide[2:]
    return np.asarray(wide[:, :-2] | wide[:, 1:-1] | wide[:, 2:])


def has_partner(own: Fronts, others: Fronts, rectangle: Rectangle, outside: bool = True) -> Array:
    """(N, 8) bool: the texels around each of `own` hold a sample of `others` on the same surface.

    On the same surface is what lies within a texel of the other's tangent plane; `outside` counts for texels that the
    picture does not have.
    """
    column, row = own.ray % rectangle.width, own.ray // rectangle.width
    out = np.zeros((len(own.ray), len(_AROUND)), bool)
    for number, (dv, du) in enumerate(_AROUND):
        target = own.ray + dv * rectangle.width + du
        inside = (column + du >= 0) & (column + du < rectangle.width)
        inside &= (row + dv >= 0) & (row + dv < rectangle.height)
        at, end = np.searchsorted(others.ray, target), np.searchsorted(others.ray, target, side="right")
        found = ~inside & outside
        while len(trial := np.flatnonzero(inside & ~found & (at < end))):
            other = at[trial]
            apart = others.points[other] - own.points[trial]
            off = np.minimum(
                np.abs((apart * own.normals[trial]).sum(axis=1)), np.abs((apart * others.normals[other]).sum(axis=1))
            )
            found[trial] = off <= rectangle.texel
            at[trial] += 1
        out[:, number] = found
    return out


def look_closely(texels: Array, rectangle: Rectangle, caster: MeshCaster) -> Fronts:
    """Meet surfaces by rays through 3 x 3 places of texels (T,), and put together what is one surface."""
    places = np.linspace(-0.5, 0.5, ALONG)
    across, down = np.tile(places, ALONG), np.repeat(places, ALONG)
    column, row = texels % rectangle.width, texels // rectangle.width
    origins, directions = rectangle.rays_at(
        (column[:, None] + 0.5 + across).ravel(), (row[:, None] + 0.5 + down).ravel()
    )
    met = _met(caster, origins, directions, np.arange(len(origins)))
    texel, place = np.divmod(met.ray, ALONG * ALONG)
    starts = np.searchsorted(texel, np.arange(len(texels) + 1)).astype(np.int64)
    leader = np.full(len(texel), -1, np.int64)
    normals = np.ascontiguousarray(met.normals, np.float64)
    group_hits(starts, place, met.points, normals, GAP * rectangle.texel, leader)
    leads, group = np.unique(leader, return_inverse=True)
    found = replace(met[leads], normals=_mean_normals(normals, group, len(leads)))
    origins, directions = rectangle.rays_at(column[texel[leads]] + 0.5, row[texel[leads]] + 0.5)
    depth = _depth_in_middle(found, origins, directions, rectangle)
    coverage = np.bincount(group, SHARES[place], len(leads)).astype(np.float32)
    return Fronts(texels[texel[leads]], depth, found.points, found.normals, found.face, coverage)


def _mean_normals(normals: Array, group: Array, count: int) -> Array:
    """Mean unit normals (count, 3) of groups: a thin thing bends within a texel, and faces where most of it does."""
    total = np.stack([np.bincount(group, normals[:, axis], count) for axis in range(3)], axis=1)
    return (total / np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-12)).astype(np.float32)


def _depth_in_middle(found: Fronts, origins: Array, directions: Array, rectangle: Rectangle) -> Array:
    """Carry depths (N,) on to the middles of their texels along the tangent planes, by a texel at the most."""
    along = (directions * found.normals).sum(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        there = ((found.points - origins) * found.normals).sum(axis=1) / along
    reach = rectangle.texel
    step = np.where(np.isfinite(there), there - found.depth, 0.0)
    return (found.depth + np.clip(step, -reach, reach)).astype(np.float32)
