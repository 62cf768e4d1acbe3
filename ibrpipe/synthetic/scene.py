"""What a synthetic scene is and how a point of it shines."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ibrpipe.embree import MeshCaster
from ibrpipe.synthetic.light import Studio, Triple
from ibrpipe.synthetic.surfaces import SmoothMesh
from ibrpipe.types import Array, Mesh

#: maps world points (N, 3) to linear diffuse reflectances (N, 3)
Paint = Callable[[Array], Array]


@dataclass(frozen=True)
class Gloss:
    """A clear coat: Schlick's Fresnel term (schlick1994) times what the mirror direction sees.

    Attributes
    ----------
    normal_reflectance : reflectance at normal incidence
    grazing_reflectance : reflectance at grazing incidence: 1 for a polished coat, less for a rough one
    exponent : of the Phong lobes of the lamps
    """

    normal_reflectance: float = 0.05
    grazing_reflectance: float = 1.0
    exponent: float = 400.0


@dataclass(frozen=True, eq=False)
class Part:
    """One surface of a scene, its paint and its coat (None = purely diffuse).

    Attributes
    ----------
    back : what a sheet shows from behind; None = a closed body, or a sheet that nobody sees from behind
    """

    name: str
    shape: SmoothMesh
    paint: Paint
    gloss: Gloss | None = None
    back: Paint | None = None


@dataclass(frozen=True)
class Rig:
    """Where the photos are taken from: rings of equal elevation around the middle of the scene.

    Attributes
    ----------
    elevations_deg : lowest and highest ring
    azimuths_deg : first and last azimuth; a span of 360 closes the rings
    rings : number of rings
    fov_y_deg : vertical field of view
    """

    elevations_deg: tuple[float, float] = (-12.0, 64.0)
    azimuths_deg: tuple[float, float] = (0.0, 360.0)
    rings: int = 4
    fov_y_deg: float = 32.0


@dataclass(frozen=True, eq=False)
class Scene:
    """A complete description of what the synthetic camera sees.

    Attributes
    ----------
    name, summary : what it is
    parts : its surfaces; their triangles are numbered one after the other
    studio : its light
    rig : where photos are taken from
    backdrop : linear colours at the top and the bottom of every photo where nothing is hit
    """

    name: str
    summary: str
    parts: tuple[Part, ...]
    studio: Studio
    rig: Rig = Rig()
    backdrop: tuple[Triple, Triple] = ((0.30, 0.29, 0.28), (0.16, 0.155, 0.15))


@dataclass(frozen=True, eq=False)
class StagedScene:
    """A scene prepared for photography: one mesh, vertex normals, vertex occlusion, ready for rays.

    Attributes
    ----------
    scene : Scene
    caster : MeshCaster
        Of all parts together; vertices are rounded to float32 so that the mesh file is the truth.
    normals : (V, 3) float64
    openness, back_openness : (V,) float64
        Share of the (cosine-weighted) sky that the scene itself does not hide, before and behind the surface.
    part : (F,) int32
        Part of each triangle.
    """

    scene: Scene
    caster: MeshCaster
    normals: Array
    openness: Array
    back_openness: Array
    part: Array


@dataclass(frozen=True, eq=False)
class Samples:
    """Surface points that rays have met.

    Attributes
    ----------
    points, normals : (N, 3) float64; normals are those of the side that is seen
    openness, part : (N,)
    behind : (N,) bool, a sheet is seen from behind
    """

    points: Array
    normals: Array
    openness: Array
    part: Array
    behind: Array


def joined_mesh(parts: tuple[Part, ...]) -> tuple[Mesh, Array]:
    """Join the parts' triangles: one mesh with float32 vertices, and the part of every triangle (F,) int32."""
    starts = np.cumsum([0] + [len(part.shape.mesh.vertices) for part in parts])
    vertices = np.concatenate([part.shape.mesh.vertices for part in parts]).astype(np.float32)
    faces = np.concatenate([part.shape.mesh.faces + start for part, start in zip(parts, starts)])
    owner = np.repeat(np.arange(len(parts), dtype=np.int32), [len(part.shape.mesh.faces) for part in parts])
    return Mesh(vertices.astype(np.float64), faces), owner


def prepare_scene(scene: Scene, occlusion_rays: int = 64) -> StagedScene:
    """Build the ray caster and the occlusion of a scene; `occlusion_rays` = 0 leaves every point open."""
    mesh, owner = joined_mesh(scene.parts)
    caster = MeshCaster(mesh)
    normals = np.concatenate([part.shape.normals for part in scene.parts])
    openness = _openness(caster, caster.mesh.vertices, normals, occlusion_rays)
    back = np.ones(len(normals))
    sheet = np.repeat([part.back is not None for part in scene.parts], [len(p.shape.normals) for p in scene.parts])
    if sheet.any():
        back[sheet] = _openness(caster, caster.mesh.vertices[sheet], -normals[sheet], occlusion_rays)
    return StagedScene(scene, caster, normals, openness, back, owner)


def _openness(caster: MeshCaster, points: Array, normals: Array, rays: int) -> Array:
    """Share of `rays` cosine-weighted directions (a Fibonacci disc, the same for every point) that meet nothing."""
    openness = np.zeros(len(normals))
    if rays == 0:
        return openness + 1.0
    side = np.where(np.abs(normals[:, 2:]) < 0.9, (0.0, 0.0, 1.0), (1.0, 0.0, 0.0))
    x = np.cross(side, normals)
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    y = np.cross(normals, x)
    size = float(np.ptp(caster.mesh.vertices, axis=0).max())
    start = points + (2e-3 * size) * normals
    for i in range(rays):
        radius, angle = np.sqrt((i + 0.5) / rays), i * np.pi * (3.0 - np.sqrt(5.0))
        up = np.sqrt(1.0 - radius**2)
        d = radius * (np.cos(angle) * x + np.sin(angle) * y) + up * normals
        openness += ~caster.occluded(start, d, 0.0, 4.0 * size)
    return openness / rays


def surface_samples(staged: StagedScene, points: Array, face: Array, uv: Array, to_eye: Array | None = None) -> Samples:
    """Interpolate what is known at the vertices to points (N, 3) at barycentric `uv` (N, 2) of triangles (N,).

    Sheets show their back where the direction to the eye, (N, 3), lies behind them; None = all are seen from before.
    """
    corners = staged.caster.mesh.faces[face]
    u, v = uv.astype(np.float64).T
    weights = np.stack([1.0 - u - v, u, v], axis=1)
    normals = sum(weights[:, i : i + 1] * staged.normals[corners[:, i]] for i in range(3))
    normals = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    openness, part = (weights * staged.openness[corners]).sum(axis=1), staged.part[face]
    behind = np.zeros(len(points), bool)
    if to_eye is not None:
        sheets = np.array([each.back is not None for each in staged.scene.parts])
        behind = sheets[part] & ((staged.caster.flat_normals[face] * to_eye).sum(axis=1) < 0)
        openness = np.where(behind, (weights * staged.back_openness[corners]).sum(axis=1), openness)
        normals = np.where(behind[:, None], -normals, normals)
    return Samples(points, normals, openness, part, behind)


def albedo(scene: Scene, samples: Samples) -> Array:
    """Linear diffuse reflectance (N, 3) of surface samples."""
    colors = np.zeros_like(samples.points)
    for index, part in enumerate(scene.parts):
        mine = np.asarray(samples.part == index) & ~samples.behind
        colors[mine] = part.paint(samples.points[mine])
        if part.back is not None:
            behind = np.asarray(samples.part == index) & samples.behind
            colors[behind] = part.back(samples.points[behind])
    return colors


def diffuse_light(scene: Scene, samples: Samples) -> Array:
    """View-independent radiance (N, 3): reflectance times irradiance times openness."""
    received = scene.studio.irradiance(samples.normals) * samples.openness[:, None]
    return albedo(scene, samples) * received


def coat_light(scene: Scene, samples: Samples, to_eye: Array) -> Array:
    """View-dependent radiance (N, 3) towards unit vectors `to_eye` (N, 3): Fresnel times mirrored light."""
    light = np.zeros_like(samples.points)
    for index, part in enumerate(scene.parts):
        if part.gloss is None:
            continue
        mine = np.flatnonzero(samples.part == index)
        n, v = samples.normals[mine], to_eye[mine]
        cosine = np.clip((n * v).sum(axis=1, keepdims=True), 0.0, 1.0)
        mirrored = 2.0 * cosine * n - v
        f0, f90 = part.gloss.normal_reflectance, part.gloss.grazing_reflectance
        fresnel = f0 + (f90 - f0) * (1.0 - cosine) ** 5
        seen = scene.studio.radiance(mirrored) + scene.studio.glints(mirrored, part.gloss.exponent)
        light[mine] = fresnel * seen * samples.openness[mine, None]
    return light
