"""Photos of a synthetic scene: several rays per pixel, box filter; and its truth, one ray per pixel centre."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ibrpipe.synthetic.scene import Samples, Scene, StagedScene, coat_light, diffuse_light, surface_samples
from ibrpipe.types import Array, Camera


@dataclass(frozen=True, eq=False)
class Photo:
    """What the synthetic camera records.

    Attributes
    ----------
    color : (H, W, 3) float64, linear light, backdrop included
    diffuse : (H, W, 3) float64, the same without the coat's reflections
    coverage : (H, W) float64, share of the pixel that the object fills
    """

    color: Array
    diffuse: Array
    coverage: Array


@dataclass(frozen=True, eq=False)
class Truth:
    """What is known at the pixel centres.

    Attributes
    ----------
    depth : (H, W) float32, along camera z, scene units, +inf = nothing there
    normal : (H, W, 3) float32, interpolated shading normal, world axes, 0 = nothing there
    """

    depth: Array
    normal: Array


def _hits(staged: StagedScene, camera: Camera, x: Array, y: Array) -> tuple[Array, Array, Samples, Array]:
    """Cast pixel positions x, y (N,): indices of hits (M,), their depth, the samples and unit vectors to the eye."""
    rays = camera.pixel_rays(np.stack([x, y], axis=-1))
    hits = staged.caster.cast(camera.center, rays)
    hit = np.flatnonzero(hits.face >= 0)
    depth, rays = hits.t[hit].astype(np.float64), rays[hit]
    points, to_eye = camera.center + depth[:, None] * rays, -rays / np.linalg.norm(rays, axis=1, keepdims=True)
    return hit, depth, surface_samples(staged, points, hits.face[hit], hits.uv[hit], to_eye), to_eye


def _backdrop(scene: Scene, camera: Camera) -> Array:
    """Vertical gradient behind the object, (H, W, 3)."""
    top, bottom = (np.array(color) for color in scene.backdrop)
    share = (np.arange(camera.height) + 0.5)[:, None, None] / camera.height
    return np.broadcast_to(top + (bottom - top) * share, (camera.height, camera.width, 3))


def _window(staged: StagedScene, camera: Camera) -> tuple[Array, Array]:
    """Columns and rows (flattened, int64) of the pixels in which the scene may appear."""
    seen = staged.caster.mesh.vertices @ camera.R.T + camera.t
    spans = [np.arange(size) for size in (camera.width, camera.height)]
    if seen[:, 2].min() > 0:
        pixels = (seen @ camera.K.T)[:, :2] / seen[:, 2:]
        low, high = np.floor(pixels.min(axis=0)), np.ceil(pixels.max(axis=0))
        spans = [span[(span >= lo) & (span < hi)] for span, lo, hi in zip(spans, low, high)]
    columns, rows = np.meshgrid(*spans)
    return columns.ravel(), rows.ravel()


def take_photo(staged: StagedScene, camera: Camera, rays: int) -> Photo:
    """Photograph a scene with `rays` x `rays` rays per pixel, evenly spaced; 1 = one ray through the centre."""
    count = camera.width * camera.height
    columns, rows = _window(staged, camera)
    pixel = rows * camera.width + columns
    light, matt, coverage = np.zeros((count, 3)), np.zeros((count, 3)), np.zeros(count)
    for i in range(rays * rays):
        x, y = columns + (i % rays + 0.5) / rays, rows + (i // rays + 0.5) / rays
        hit, _, samples, to_eye = _hits(staged, camera, x, y)
        at = pixel[hit]
        diffuse = diffuse_light(staged.scene, samples)
        matt[at] += diffuse
        light[at] += diffuse + coat_light(staged.scene, samples, to_eye)
        coverage[at] += 1.0
    shape, scale = (camera.height, camera.width), 1.0 / (rays * rays)
    share = coverage.reshape(shape) * scale
    behind = _backdrop(staged.scene, camera) * (1.0 - share)[..., None]
    return Photo(light.reshape(*shape, 3) * scale + behind, matt.reshape(*shape, 3) * scale + behind, share)


def measure_truth(staged: StagedScene, camera: Camera) -> Truth:
    """Depth and normal at the pixel centres."""
    count, shape = camera.width * camera.height, (camera.height, camera.width)
    columns, rows = _window(staged, camera)
    hit, depth, samples, _ = _hits(staged, camera, columns + 0.5, rows + 0.5)
    at = (rows * camera.width + columns)[hit]
    depths, normals = np.full(count, np.inf, np.float32), np.zeros((count, 3), np.float32)
    depths[at], normals[at] = depth, samples.normals
    return Truth(depths.reshape(shape), normals.reshape(*shape, 3))
