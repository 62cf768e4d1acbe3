"""Exact pictures of scenes of copies: all copies taken apart, every ray against every triangle, in float64.

A ray leaves out only triangles beside whose box in the picture it passes. Nothing of the renderers is used. Triangles
and rays are counted from the eye, so that a scene a million units from the origin costs no digits.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ibrpipe.bench.oracles.triangles import nearest_triangles
from ibrpipe.types import Array, Camera, Lighting, Scene


@dataclass(frozen=True, eq=False)
class ExactPicture:
    """What a camera sees.

    Attributes
    ----------
    cover : (H, W) float64
        Share of the samples of a pixel that show something.
    color : (H, W, 3) float64
        Mean light of all samples, linear, black where nothing is seen: premultiplied by `cover`.
    depth : (H, W) float64
        Median over the samples, along camera z; +inf where less than half of the pixel is covered.
    """

    cover: Array
    color: Array
    depth: Array


def cast_scene(scene: Scene, camera: Camera, near: float, side: int) -> ExactPicture:
    """Return the picture of all that lies beyond `near`, with side x side samples a pixel.

    Light is albedo times (ambient + sum of light times max(0, n.L)), n turned to the viewer.
    """
    corners, paints = triangles_of(scene)
    corners = (corners - camera.center) @ camera.R.T
    rays = _sample_rays(camera, side)
    depth, face = np.full(len(rays), np.inf), np.full(len(rays), -1, np.int64)
    nearest_triangles(rays, corners, _boxes(corners), near, depth, face)
    lights = np.array([light.direction for light in scene.lighting.lights]).reshape(-1, 3) @ camera.R.T
    light = _light(rays, depth, face, (corners, paints), lights, scene.lighting)
    shape = (camera.height, camera.width, side * side)
    depth = depth.reshape(shape)
    return ExactPicture(
        np.isfinite(depth).mean(axis=-1), light.reshape(*shape, 3).mean(axis=2), np.sort(depth)[..., (side * side) // 2]
    )


def triangles_of(scene: Scene) -> tuple[Array, Array]:
    """Corners and albedo (F, 3, 3) float64 of all triangles of a scene, in the world."""
    meshes = scene.flattened(scene.root)
    nothing = np.zeros((0, 3, 3))
    return (
        np.concatenate([nothing, *(each.mesh.vertices[each.mesh.faces] for each in meshes)]),
        np.concatenate([nothing, *(each.color[each.mesh.faces] for each in meshes)]),
    )


def _sample_rays(camera: Camera, side: int) -> Array:
    """(H W side^2, 3) float64 directions in the camera's frame, z = 1, pixel by pixel."""
    step = (np.arange(side) + 0.5) / side
    rows, columns, y, x = np.meshgrid(np.arange(camera.height), np.arange(camera.width), step, step, indexing="ij")
    places = np.stack([columns + x, rows + y, np.ones(x.shape)], axis=-1).reshape(-1, 3)
    return places @ np.linalg.inv(camera.K).T


def _boxes(corners: Array) -> Array:
    """(F, 4) float64 least and greatest x / z, least and greatest y / z of triangles, a little wider.

    Those that reach behind the eye have no bounds.
    """
    z = corners[..., 2]
    slopes = corners[..., :2] / np.where(z > 0.0, z, 1.0)[..., None]
    low, high = slopes.min(axis=1), slopes.max(axis=1)
    slack = 1e-9 * (1.0 + np.maximum(np.abs(low), np.abs(high)))
    boxes = np.stack([low - slack, high + slack], axis=-1).reshape(-1, 4)
    boxes[(z <= 0.0).any(axis=1)] = (-np.inf, np.inf, -np.inf, np.inf)
    return boxes


def _light(
    rays: Array, depth: Array, face: Array, mesh: tuple[Array, Array], lights: Array, lighting: Lighting
) -> Array:
    """(N, 3) float64 light of what the rays hit, 0 where that is nothing."""
    corners, paints = mesh
    light, hit = np.zeros((len(rays), 3)), face >= 0
    if not hit.any():
        return light
    a, b, c = (corners[face[hit], n] for n in range(3))
    normal = np.cross(b - a, c - a)
    doubled = np.linalg.norm(normal, axis=1)
    point = rays[hit] * depth[hit, None]
    w1 = np.einsum("ni,ni->n", np.cross(c - a, point - a), -normal) / doubled**2
    w2 = np.einsum("ni,ni->n", np.cross(b - a, point - a), normal) / doubled**2
    weights = np.stack([1 - w1 - w2, w1, w2], axis=1)
    normal /= np.where(np.einsum("ni,ni->n", normal, rays[hit]) > 0, -doubled, doubled)[:, None]
    received = np.broadcast_to(lighting.ambient, (len(a), 3)).copy()
    for direction, each in zip(lights, lighting.lights, strict=True):
        received += np.maximum(normal @ direction, 0.0)[:, None] * each.color
    light[hit] = np.einsum("nk,nkc->nc", weights, paints[face[hit]]) * received
    return light
