"""Shadows and ambient occlusion: what lights, and the sky all around, see of a scene. Source: max1999, sec. 4."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ibrpipe.core.hierarchy import shadow as kernels
from ibrpipe.renderers.hierarchical.captured import CapturedThing
from ibrpipe.renderers.hierarchical.guide import sphere_around
from ibrpipe.renderers.hierarchical.nodes import OWN, Nodes
from ibrpipe.types import Array, Camera

#: distance of a light's eye over the radius of what it sees: rays are parallel to 0.3 degrees
DISTANCE = 200.0
#: bias in texels of what a light sees, and in pixels of the picture: half a slab of slices is three texels thick. Many
#: directions of the sky even out by themselves what a smaller one lets leaves hide of themselves
LIGHT_BIAS, SKY_BIAS = 3.0, 0.5
#: texels of depth that slopes may add to it
STEEPEST = 20.0
#: texels along a side of the pictures that the sky sees
SKY_SIZE = 512

#: draws the depth (H, W) that a camera sees
DepthOf = Callable[[Camera], Array]


@dataclass(frozen=True, eq=False)
class ShadowMaps:
    """What lights see.

    Attributes
    ----------
    depths : (M, N, N) float32
        Along the light's axis, +inf where there is nothing.
    lights : (M, 3, 4) float64
        Pixel (u w, v w, w) of a place of the world.
    texels : (M,) float64
        Width of a texel, scene units.
    bias : float
        By how many texels, and pixels of the picture, a place may lie behind what is seen.
    """

    depths: Array
    lights: Array
    texels: Array
    bias: float

    @property
    def bytes(self) -> int:
        """Bytes held."""
        return int(self.depths.nbytes)

    def reach(self, depth: Array, camera: Camera) -> Array:
        """Return (M, H, W) float32: the share of each light that reaches what a camera sees at `depth` (H, W)."""
        out = np.empty((len(self.depths), *depth.shape), np.float32)
        view = np.empty((3, 4))
        view[:, :3], view[:, 3] = camera.R.T @ np.linalg.inv(camera.K), camera.center
        biases = np.stack([self.bias * self.texels, STEEPEST * self.texels], axis=1)
        footprint = self.bias / min(camera.K[0, 0], camera.K[1, 1])
        kernels.visibility(depth, view, self.depths, self.lights, biases, footprint, out)
        return out


def shadow_maps(sphere: Array, directions: Array, size: int, bias: float, depth_of: DepthOf) -> ShadowMaps:
    """Draw what lights from `directions` (M, 3) see of a sphere (4,), size x size texels each."""
    cameras = [light_camera(sphere, direction, size) for direction in directions]
    depths = [depth_of(camera) for camera in cameras]
    lights = [camera.K @ camera.cam_from_world for camera in cameras]
    return ShadowMaps(
        np.stack(depths) if depths else np.zeros((0, size, size), np.float32),
        np.array(lights).reshape(-1, 3, 4),
        np.full(len(cameras), 2.0 * sphere[3] / size),
        bias,
    )


def light_camera(sphere: Array, direction: Array, size: int) -> Camera:
    """The camera of a light: far away in its direction, all of the sphere (4,) in view."""
    radius = max(float(sphere[3]), 1e-9)
    aside = (1.0, 0.0, 0.0) if abs(direction[2]) > 0.9 else (0.0, 0.0, 1.0)
    fov = float(np.degrees(2.0 * np.arctan(1.0 / DISTANCE)))
    eye = sphere[:3] + DISTANCE * radius * direction
    return Camera.look_at(eye, sphere[:3], up=aside, fov_y_deg=fov, width=size, height=size)


def casting_sphere(nodes: Nodes, spheres: Array, captured: Sequence[CapturedThing] = ()) -> Array:
    """(4,) float64: sphere around all that the root holds copies of and all captured things, or else around the root.

    The root's own meshes are often ground, far wider than what stands on it.
    """
    held = np.arange(nodes.copies[nodes.root], nodes.copies[nodes.root + 1])
    copied = [n for n in held if not nodes.names[nodes.children[n]].endswith(OWN)]
    inner, matrices = [spheres[nodes.children[copied]]], [nodes.matrices[copied]]
    for thing in captured:
        inner.append(np.tile(np.append(thing.bounds.center, thing.bounds.radius), (len(thing.matrices), 1)))
        matrices.append(thing.matrices[:, :3].reshape(-1, 12))
    found = sphere_around(np.concatenate(inner), np.concatenate(matrices))
    return found if found[3] > 0 else spheres[nodes.root]
