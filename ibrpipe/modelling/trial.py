"""Try out what a capture could be modelled with: fit without some photos, and predict these.

Layers are built at their full size, but only tiles of them, spread over the object, are fitted and scored: how well
texels say what photos show depends on their size, hardly on how many of them there are.

Pixels near depth edges and of holes say nothing of how colour depends on the view: what is wrong there is geometry.
Only ways to make diffuse colours are compared on them, too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ibrpipe.capture.photo_set import PhotoSet
from ibrpipe.core.appearance.depth_edges import beside_edge
from ibrpipe.core.color import srgb_encode
from ibrpipe.embree import MeshCaster
from ibrpipe.modelling.diffuse_refinement import sample_points, sharpen
from ibrpipe.modelling.layers import LayersConfig, build_layers
from ibrpipe.modelling.plan_file import TexturePlan
from ibrpipe.modelling.rectangles import passed
from ibrpipe.modelling.view_dependence.reflection.choice import BONUS
from ibrpipe.modelling.view_dependence.reflection.first_guess import first_colors, seen_weight
from ibrpipe.modelling.view_dependence.reflection.fit import FitRules, fit, make_law
from ibrpipe.modelling.view_dependence.reflection.observations import (
    Observations,
    agreed,
    join,
    observe_pixels,
    observe_texels,
)
from ibrpipe.renderers.ldi.renderer import find_hits
from ibrpipe.renderers.scene import Scene, prepare
from ibrpipe.renderers.view_dependence.mirror import Looks, Surface, make_surface
from ibrpipe.renderers.view_dependence.reflection import Model, look_through, shade_looks
from ibrpipe.types import Array, LayeredDepthImage

#: photos that there must be, and from which on every eighth, not every fourth, is left out
LEAST, MANY = 8, 16
#: texels along the edge of a tile; observations that are fitted, about
TILE, OBSERVED = 24, 250_000
#: pixels from a depth edge within which nothing is scored
MARGIN = 2
#: samples of which pixels say less are observed at their own places, too
RARELY_SEEN = 3.0
#: the lumigraph is not expected to gain more by halving the angle between photos, dB (3.6 on a mirroring vase)
STEEPEST = 3.5
#: loss of one table against none up to which two are tried, dB
NEARLY = 0.5
#: names of what is tried
MEDIAN, SHARPENED, LUMIGRAPH, THIN = "median", "sharpened", "lumigraph", "thinned lumigraph"
TABLES = ("joint", "1 table", "2 tables")


@dataclass(frozen=True)
class Trial:
    """How well photos that were left out are predicted.

    Attributes
    ----------
    pixels : (T,) int64
        Pixels that were scored, by the texture through whose rectangle they are seen.
    squares : dict of (T,) float64
        Mean squares in display code of those pixels by what predicts them; 0 where there are none.
    angles : (float, float)
        Median angle from the photos left out to the nearest of those kept, and of the thinned ones, degrees.
    everywhere : dict of float
        Mean squares by models where edges and holes count, too.
    """

    pixels: Array
    squares: dict[str, Array]
    angles: tuple[float, float]
    everywhere: dict[str, float]

    def psnr_everywhere(self, name: str) -> float:
        """PSNR over all pixels of surface that is drawn, edges and holes too, dB."""
        return decibel(self.everywhere[name])

    def psnr(self, name: str) -> float:
        """PSNR over all pixels, dB."""
        return decibel(self.mean(self.squares[name]))

    def mean(self, squares: Array) -> float:
        """Mean over all pixels of a mean square (T,) of every texture."""
        return float((self.pixels * squares).sum() / max(int(self.pixels.sum()), 1))

    def lumigraph_at(self, spacing: float) -> float:
        """Factor by which the lumigraph's squares fall where views lie between photos, not at one left out.

        Leaving a photo out doubles the angle to the next one. How much that costs is told by the thinned photos.
        """
        near, far = self.angles
        octaves = np.log2(max(far / near, 1.0)) if near > 0 else 0.0
        if octaves < 0.1:
            return 1.0
        slope = np.clip((self.psnr(LUMIGRAPH) - self.psnr(THIN)) / octaves, 0.0, STEEPEST)
        return float(10 ** (-0.1 * slope * np.clip(np.log2(near / (0.5 * spacing)), 0.0, 1.5)))

    def best_tables(self) -> int:
        """Tables that predict best, if fewer are forgiven a little."""
        found = [self.psnr(name) + BONUS[n] for n, name in enumerate(TABLES) if name in self.squares]
        return int(np.argmax(found))


def decibel(square: float) -> float:
    """PSNR of a mean square in display code (0 to 1), dB."""
    return float(-10 * np.log10(max(square, 1e-10)))


@dataclass(frozen=True, eq=False)
class _Ground:
    """Layers made from the kept photos, as a surface to fit on; `wanted` (P,) patches and `chosen` (S,) samples."""

    layers: list[LayeredDepthImage]
    scene: Scene
    surface: Surface
    points: Array
    wanted: Array
    chosen: Array

    @property
    def colors(self) -> Array:
        """(S, 3) float32 diffuse colours of the layers, linear."""
        return np.concatenate([each.color for each in self.layers])


@dataclass(frozen=True, eq=False)
class _Test:
    """Places (N,) that a photo left out shows.

    Attributes
    ----------
    seen : Looks
    toward : (N, 3) float64, unit, to the photo
    truth : (N, 3) float32, what it shows, display code
    owner : (N,) int64, texture through whose rectangle it is seen
    clear : (N,) bool, away from edges, and seen by other photos
    """

    seen: Looks
    toward: Array
    truth: Array
    owner: Array
    clear: Array


def try_out(
    plans: Sequence[TexturePlan],
    caster: MeshCaster,
    photos: PhotoSet,
    seed: int,
    most: int = 2,
    rules: FitRules | None = None,
) -> Trial | None:
    """Fit the candidates without some of the photos and score them on these; None where there are too few photos.

    Parameters
    ----------
    most : tables at the most; 0 where nothing changes with the view
    """
    count, rules = len(photos.cameras), rules or FitRules()
    if count < LEAST:
        return None
    every = 8 if count >= MANY else 4
    left_out = np.arange(count) % every == every // 2
    kept, tested = (photos.subset(np.flatnonzero(each).tolist()) for each in (~left_out, left_out))
    ground = _ground(plans, caster, kept, seed)
    tests = [_test(plans, ground, tested, p, rules.size) for p in range(len(tested.cameras))]
    center = caster.mesh.vertices.mean(axis=0)
    thin = kept.subset(spread(kept.centers - center, max(2, len(kept.cameras) // 4)))
    views = [tested.centers - center, kept.centers - center, thin.centers - center]
    tests = [_seen_by_both(test, kept, thin) for test in tests]
    pixels = np.bincount(np.concatenate([test.owner[test.clear] for test in tests]), minlength=len(plans))
    trial = Trial(pixels, {}, (_angle(views[0], views[1]), _angle(views[0], views[2])), {})
    for name, photo_set in ((LUMIGRAPH, kept), (THIN, thin)):
        trial.squares[name], _ = _score(tests, plans, photo_set)
    _score_model(trial, MEDIAN, tests, plans, _matt(ground.colors, rules), ground.surface)
    _fit_and_score(trial, ground, tests, plans, caster, kept, rules, most)
    if trial.best_tables() == 0:
        sharp, _ = sharpen([p.rectangle for p in plans], ground.layers, [True] * len(plans), caster, kept, 1, 0)
        model = _matt(np.concatenate([each.color for each in sharp]), rules)
        _score_model(trial, SHARPENED, tests, plans, model, ground.surface)
    return trial


def _ground(plans: Sequence[TexturePlan], caster: MeshCaster, kept: PhotoSet, seed: int) -> _Ground:
    """Build the layers, and choose tiles of them that hold about as many observations as are to be fitted."""
    layers = [build_layers(which, plans, caster, kept, LayersConfig())[0] for which in range(len(plans))]
    scene = prepare(tuple(layers))
    surface = make_surface(scene, np.concatenate([each.normal for each in layers]))
    surface = replace(surface, corners=np.ascontiguousarray(surface.records[:, 4:]))
    shown = sum(int((kept.mask[slice(s, s + h * w)] >= 0.5).sum()) for s, (h, w) in _pixel_runs(kept))
    share = min(1.0, 2.0 * OBSERVED / max(shown, 1))
    rng = np.random.default_rng(seed)
    chosen = np.concatenate([_in_tiles(each, share, rng) for each in layers])
    wanted = np.asarray(np.append(chosen, False)[surface.corners].any(axis=1))
    points = np.concatenate([sample_points(plan.rectangle, each) for plan, each in zip(plans, layers, strict=True)])
    return _Ground(layers, scene, surface, points, wanted, chosen)


def _pixel_runs(photos: PhotoSet) -> list[tuple[int, tuple[int, int]]]:
    """First pixel, height and width of every photo."""
    return [(int(photos.starts[p]), (c.height, c.width)) for p, c in enumerate(photos.cameras)]


def _in_tiles(layers: LayeredDepthImage, share: float, rng: np.random.Generator) -> Array:
    """(S,) bool: samples in a share of the tiles, drawn by chance."""
    height, width = layers.offsets.shape[0], layers.offsets.shape[1] - 1
    tiles = rng.random((height // TILE + 1, width // TILE + 1)) < share
    row, column = np.divmod(np.arange(height * width), width)
    return np.repeat(tiles[row // TILE, column // TILE], np.diff(layers.offsets, axis=1).ravel())


def _test(plans: Sequence[TexturePlan], ground: _Ground, tested: PhotoSet, p: int, size: int) -> _Test:
    """Find the pixels of one photo by which candidates are scored."""
    camera, first = tested.cameras[p], int(tested.starts[p])
    shape, own = (camera.height, camera.width), slice(first, first + camera.height * camera.width)
    depth, mask = tested.depth[own].reshape(shape), tested.mask[own].reshape(shape)
    hits = find_hits(ground.scene, camera)
    taken = agreed(hits.depth, depth, camera) & (mask >= 0.95)
    taken[taken] = ground.wanted[hits.ids[taken]]
    seen = look_through(ground.surface, camera, hits.depth, hits.ids, taken, size)
    toward = camera.center - seen.points
    toward /= np.linalg.norm(toward, axis=1, keepdims=True)
    owner = passed([plan.rectangle for plan in plans], seen.points, toward)
    clear = ~_widened(beside_edge(depth, mask), MARGIN)[taken] & np.isfinite(seen.normals[:, 0])
    return _Test(seen, toward, tested.code[own].reshape(*shape, 3)[taken], owner, clear)


def _widened(where: Array, pixels: int) -> Array:
    """Grow what is true in (H, W) by so many pixels along rows and columns."""
    for _ in range(pixels):
        padded = np.pad(where, 1)
        where = where | padded[:-2, 1:-1] | padded[2:, 1:-1] | padded[1:-1, :-2] | padded[1:-1, 2:]
    return where


def _seen_by_both(test: _Test, kept: PhotoSet, thin: PhotoSet) -> _Test:
    """Clear is only what two kept photos or more and one thinned photo see."""
    seen, clear, at = test.seen, test.clear.copy(), np.flatnonzero(test.clear)
    counts = [photos.blend(seen.points[at], seen.normals[at], test.toward[at])[1] for photos in (kept, thin)]
    clear[at] = (counts[0] >= 2) & (counts[1] >= 1)
    return replace(test, clear=clear)


def _score(
    tests: Sequence[_Test], plans: Sequence[TexturePlan], source: PhotoSet | Model, surface: Surface | None = None
) -> tuple[Array, float]:
    """Mean squares (T,) of what a model, or the best four photos, predict where it is clear, and a model's mean."""
    total, count, everywhere, shown = np.zeros(len(plans)), np.zeros(len(plans)), 0.0, 0
    for test in tests:
        seen = test.seen
        light = np.zeros((len(seen.where), 3), np.float32)
        if isinstance(source, PhotoSet):
            at = np.flatnonzero(test.clear)
            light[at] = source.blend(seen.points[at], seen.normals[at], test.toward[at])[0]
        elif surface is not None:
            seen.traits[:, 9:] = np.nan
            light = shade_looks(surface, source, seen)
        error = (srgb_encode(np.nan_to_num(light)) - np.minimum(test.truth, 1.0)).astype(np.float64) ** 2
        total += np.bincount(test.owner[test.clear], error.mean(axis=1)[test.clear], len(plans))
        count += np.bincount(test.owner[test.clear], minlength=len(plans))
        everywhere, shown = everywhere + float(error.mean(axis=1).sum()), shown + len(error)
    return total / np.maximum(count, 1), everywhere / max(shown, 1)


def _score_model(
    trial: Trial, name: str, tests: Sequence[_Test], plans: Sequence[TexturePlan], model: Model, surface: Surface
) -> None:
    trial.squares[name], trial.everywhere[name] = _score(tests, plans, model, surface)


def _matt(colors: Array, rules: FitRules) -> Model:
    """Diffuse colours (S, 3), linear, as a model."""
    none = np.empty((0, rules.size, rules.size, 3), np.float32)
    return Model(np.sqrt(np.maximum(np.nan_to_num(colors), 0.0)).astype(np.float32), none, make_law(0, rules))


def _fit_and_score(
    trial: Trial,
    ground: _Ground,
    tests: Sequence[_Test],
    plans: Sequence[TexturePlan],
    caster: MeshCaster,
    kept: PhotoSet,
    rules: FitRules,
    most: int,
) -> None:
    """Fit ever more tables while they help, or nearly do, and score each.

    Where some is matt and some is glossy one table, which all of it must show, may cost as much as it brings, and two,
    which every sample weighs, may pay.
    """
    surface = ground.surface
    seen = observe_pixels(ground.scene, surface, kept, rules.size, wanted=ground.wanted)
    rare = ground.chosen & (seen_weight(seen, surface.corners, len(ground.points)) < RARELY_SEEN)
    own = observe_texels(surface, ground.points, rare, caster, kept, rules.size)
    observations: Observations = seen if own is None else join([seen, own])
    first = first_colors(observations, surface.corners, len(ground.points))
    first = np.where(np.isfinite(first), first, ground.colors)  # elsewhere the median stays, for what is mirrored
    for tables, name in enumerate(TABLES[: most + 1]):
        _score_model(trial, name, tests, plans, fit(observations, surface.corners, first, tables, rules), surface)
        if trial.best_tables() < tables and trial.psnr(name) < trial.psnr(TABLES[0]) - NEARLY:
            break


def spread(directions: Array, count: int) -> list[int]:
    """Choose so many of the directions (N, 3) that they lie far apart, ascending."""
    unit = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    chosen = [0]
    nearest = unit @ unit[0]
    while len(chosen) < min(count, len(unit)):
        chosen.append(int(nearest.argmin()))
        nearest = np.maximum(nearest, unit @ unit[chosen[-1]])
    return sorted(set(chosen))


def _angle(views: Array, photos: Array) -> float:
    """Median angle from views (N, 3) to the nearest of the photos (P, 3), as seen from the middle, degrees."""
    one, other = (each / np.linalg.norm(each, axis=1, keepdims=True) for each in (views, photos))
    return float(np.degrees(np.median(np.arccos(np.clip((one @ other.T).max(axis=1), -1, 1)))))
