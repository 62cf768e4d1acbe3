"""Rays against a triangle mesh by Embree, through Open3D."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ibrpipe.core.normals import corner_normals, face_normals
from ibrpipe.native_imports import import_open3d
from ibrpipe.types import Array, Camera, Mesh


@dataclass(frozen=True, eq=False)
class Hits:
    """Nearest hits of N rays.

    Attributes
    ----------
    t : (N,) float32, in lengths of the ray's direction; +inf = none
    normal : (N, 3) float32, unit, of the face; outward for counter-clockwise faces
    face : (N,) int32, -1 = none
    uv : (N, 2) float32, barycentric weights of the face's second and third corner
    """

    t: Array
    normal: Array
    face: Array
    uv: Array


class MeshCaster:
    """A mesh prepared for ray casting.

    Parameters
    ----------
    mesh : Mesh
    threads : int
        0 = all.
    two_sided : (F,) bool, optional
        Faces that are hit on the side that a ray meets. `mesh` then has their backs, too, wound the other way, after
        the faces that were given, and hits name the face of the side that was met.

    Attributes
    ----------
    mesh : Mesh
    fronts : int
        Faces that were given; those from there on are backs.
    """

    def __init__(self, mesh: Mesh, threads: int = 0, two_sided: Array | None = None) -> None:
        self._o3d = import_open3d()
        self._threads = threads
        self._shift = mesh.vertices.mean(axis=0)
        self._given, self._two_sided = mesh, two_sided
        self.fronts, self._back = len(mesh.faces), np.full(len(mesh.faces), -1, np.int32)
        self.mesh = mesh if two_sided is None else self._with_backs(mesh, two_sided)
        self._scene = self._o3d.t.geometry.RaycastingScene(nthreads=threads)
        vertices = np.ascontiguousarray(mesh.vertices - self._shift, dtype=np.float32)
        faces = np.ascontiguousarray(mesh.faces, dtype=np.uint32)  # backs are no faces of the scene
        self._scene.add_triangles(self._o3d.core.Tensor(vertices), self._o3d.core.Tensor(faces))

    def __reduce__(self) -> tuple[Any, ...]:
        """Travel to other processes as the mesh; the tree over it is built again there."""
        return MeshCaster, (self._given, self._threads, self._two_sided)

    def _with_backs(self, mesh: Mesh, two_sided: Array) -> Mesh:
        chosen = np.flatnonzero(two_sided)
        self._back[chosen] = len(mesh.faces) + np.arange(len(chosen))
        return Mesh(mesh.vertices, np.concatenate([mesh.faces, mesh.faces[chosen][:, [0, 2, 1]]]))

    def _met(self, face: Array, normal: Array, uv: Array, directions: Array) -> tuple[Array, Array, Array]:
        """Take the backs of two-sided faces (..., -1 = none) where rays meet these from behind."""
        if self._two_sided is None:
            return face, normal, uv
        back = np.where(face >= 0, self._back[face], -1)
        behind = (back >= 0) & ((normal * directions).sum(axis=-1) > 0)
        wide = behind[..., None]
        return np.where(behind, back, face), np.where(wide, -normal, normal), np.where(wide, uv[..., ::-1], uv)

    def _rays(self, origins: Array, directions: Array) -> Any:
        start = np.broadcast_to(np.asarray(origins, np.float64) - self._shift, np.shape(directions))
        return self._o3d.core.Tensor(np.concatenate([start, directions], axis=-1).astype(np.float32))

    def cast(self, origins: Array, directions: Array) -> Hits:
        """Cast rays given by (..., 3) world origins and directions; `t` is in lengths of the direction."""
        found = self._scene.cast_rays(self._rays(origins, directions), nthreads=self._threads)
        face = found["primitive_ids"].numpy()
        missed = face == self._scene.INVALID_ID
        face = np.where(missed, -1, face.astype(np.int64)).astype(np.int32)
        normal, uv = found["primitive_normals"].numpy(), found["primitive_uvs"].numpy()
        face, normal, uv = self._met(face, normal, uv, directions)
        return Hits(found["t_hit"].numpy(), normal, face, uv)

    def cast_all(self, origins: Array, directions: Array) -> tuple[Array, Hits]:
        """Find every intersection of (N, 3) rays: (ray index (M,) int64, hits), by ray, then t ascending."""
        if len(directions) == 0:  # Open3D crashes on an empty list
            none = np.zeros((0, 3), np.float32)
            return np.zeros(0, np.int64), Hits(none[:, 0], none, np.zeros(0, np.int32), none[:, :2])
        found = self._scene.list_intersections(self._rays(origins, directions), nthreads=self._threads)
        ray, t = found["ray_ids"].numpy().astype(np.int64), found["t_hit"].numpy()
        order = np.lexsort((t, ray))
        face = found["primitive_ids"].numpy().astype(np.int32)[order]
        uv, ray = found["primitive_uvs"].numpy()[order], ray[order]
        face, normal, uv = self._met(face, self.flat_normals[face], uv, directions[ray])
        return ray, Hits(t[order], normal, face, uv)

    @cached_property
    def flat_normals(self) -> Array:
        """(F, 3) float32 unit normal of every face."""
        normals = face_normals(self.mesh.vertices, self.mesh.faces)
        lengths = np.linalg.norm(normals, axis=1, keepdims=True)
        return (normals / np.where(lengths > 0, lengths, 1.0)).astype(np.float32)

    @cached_property
    def _corner_normals(self) -> Array:
        return corner_normals(self.mesh.vertices, self.mesh.faces)

    def smooth_normals(self, face: Array, uv: Array) -> Array:
        """(N, 3) float32 unit normals interpolated over (N,) faces; creases stay sharp. Every face must be hit."""
        corners = self._corner_normals[face]
        blend = (
            corners[:, 0] * (1 - uv.sum(axis=1, keepdims=True)) + corners[:, 1] * uv[:, :1] + corners[:, 2] * uv[:, 1:]
        )
        return blend / np.maximum(np.linalg.norm(blend, axis=1, keepdims=True), 1e-12)

    def cast_camera(self, camera: Camera) -> Hits:
        """Cast one ray per pixel centre; `t` is then the depth along camera z, arrays are (H, W[, 3])."""
        return self.cast(camera.center, camera.pixel_rays())

    def prepared_cast(self, camera: Camera) -> Callable[[], object]:
        """Return a function that casts one ray per pixel, the rays laid out beforehand: for timing Embree alone."""
        rays = self._rays(camera.center, camera.pixel_rays())
        return lambda: self._scene.cast_rays(rays, nthreads=self._threads)

    def occluded(self, origins: Array, directions: Array, near: float, far: float) -> Array:
        """Say which (N, 3) rays meet the mesh between `near` and `far` (in lengths of the direction); (N,) bool."""
        rays = self._rays(origins, directions)
        return self._scene.test_occlusions(rays, tnear=near, tfar=far, nthreads=self._threads).numpy()

    def closest(self, points: Array) -> tuple[Array, Array]:
        """Find the nearest points of the mesh to (N, 3) world points: places (N, 3) float64, faces (N,) int32."""
        shifted = np.ascontiguousarray(points - self._shift, dtype=np.float32)
        found = self._scene.compute_closest_points(self._o3d.core.Tensor(shifted), nthreads=self._threads)
        return found["points"].numpy() + self._shift, found["primitive_ids"].numpy().astype(np.int32)
