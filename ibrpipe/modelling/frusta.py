"""Where to put perspective cameras so that few depth images cover a mesh.

Source: schaufler1999, sec. 6 and 7.1, where frusta are placed by hand. Here they are placed round the mesh like the
faces of a cube (the paper's globe), or chosen greedily: of many candidates the one that adds most surface, again and
again. Frusta can be written to a file, changed by hand, and read again; the plan stage takes them from the pipeline
file. Departure: all but `central_frusta` stand outside and look in, so that they are pictures of what an eye outside
sees; the paper's globe is displaced from its centre outward.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from pydantic import Field, TypeAdapter, ValidationError, model_validator

from ibrpipe.config import StageConfig
from ibrpipe.core.normals import face_normals
from ibrpipe.embree import MeshCaster
from ibrpipe.errors import ConfigError, ValueRangeError
from ibrpipe.types import Array, Camera, Mesh

#: surface points by which coverage is counted
POINTS = 4000
#: candidates far from the mesh and near to it
FAR, NEAR = 96, 96
#: least cosine between normal and line of sight at which a point counts as covered
FACING = 0.25
#: least share of the surface that another camera must add
GAIN = 0.0005


class Frustum(StageConfig):
    """A square perspective depth image to be taken."""

    eye: tuple[float, float, float] = Field(description="Centre of projection, world")
    target: tuple[float, float, float] = Field(description="Point in the middle of the image, world")
    up: tuple[float, float, float] = Field((0.0, 0.0, 1.0), description="Direction that is up in the image, world")
    fov: float = Field(40.0, gt=0, lt=180, description="Full angle of view, degrees")

    @model_validator(mode="after")
    def _looks_somewhere(self) -> Frustum:
        if self.eye == self.target or not any(self.up):
            raise ValueError(
                f"eye and target must differ and up must not be 0, got {self.eye}, {self.target}, {self.up}"
            )
        return self

    def camera(self, size: int) -> Camera:
        """Return the camera of `size` x `size` pixels."""
        return Camera.look_at(self.eye, self.target, self.up, self.fov, size, size)


def frusta_from_entries(entries: Any) -> tuple[Frustum, ...]:
    """Check what a file of frusta holds: a list of mappings with eye, target, up, fov.

    Raises
    ------
    ConfigError
        It is something else.
    """
    try:
        made = TypeAdapter(tuple[Frustum, ...]).validate_python(entries)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"]) or "all of it"
        raise ConfigError(
            f"this is no list of frusta ({where}: {first['msg']}); each has eye, target, up (3 numbers each) and fov"
        ) from error
    if not made:
        raise ConfigError("this list of frusta is empty; each has eye, target, up (3 numbers each) and fov")
    return made


def entries_from_frusta(frusta: Sequence[Frustum]) -> list[dict[str, Any]]:
    """Return what a file of frusta holds."""
    return [frustum.model_dump(mode="json") for frustum in frusta]


def write_frusta(frusta: Sequence[Frustum], path: Path) -> None:
    """Write a list of frusta as YAML, as `ibrpipe depth-images` and the plan's key `frusta` take it."""
    text = yaml.safe_dump(entries_from_frusta(frusta), sort_keys=False, default_flow_style=None, width=120)
    path.write_text(text, encoding="utf-8")


def _vector(values: Any) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in values)
    return x, y, z


def cube_frusta(mesh: Mesh, distance: float = 2.5) -> tuple[Frustum, ...]:
    """Return six frusta along the axes, as the faces of a cube round the mesh.

    Parameters
    ----------
    distance : float
        From the middle of the mesh, in radii of its bounding sphere; above 1.
    """
    middle, radius = _sphere(mesh)
    directions = np.concatenate([np.eye(3), -np.eye(3)])
    return tuple(_outside(middle, radius, direction, distance) for direction in directions)


def central_frusta(mesh: Mesh) -> tuple[Frustum, ...]:
    """Return six frusta from the middle of the mesh outward, which meet at their borders (the globe of the paper).

    They show what is met first from the middle, so the mesh should be met once from there, as a globe is.
    """
    middle, _ = _sphere(mesh)
    found = []
    for direction in np.concatenate([np.eye(3), -np.eye(3)]):
        up = (0.0, 0.0, 1.0) if abs(direction[2]) < 0.9 else (0.0, 1.0, 0.0)
        found.append(Frustum(eye=_vector(middle), target=_vector(middle + direction), up=up, fov=91.0))
    return tuple(found)


def greedy_frusta(mesh: Mesh, count: int, seed: int = 0) -> tuple[tuple[Frustum, ...], float]:
    """Choose at most `count` frusta that cover most of the mesh: (frusta, share of the visible surface covered).

    Candidates look at the whole mesh from all round, and at parts of it from near by. Ends early when no candidate adds
    0.05 % of the surface.
    """
    if count < 1:
        raise ValueRangeError(f"{count} depth images cannot cover anything; give at least 1")
    survey = _survey(mesh, seed)
    done = np.zeros(len(survey.points), bool)
    chosen: list[Frustum] = []
    while len(chosen) < count:
        gains = (survey.seen & ~done).sum(axis=1)
        best = int(np.argmax(gains))
        if gains[best] < max(1.0, GAIN * len(done)):
            break
        chosen.append(survey.candidates[best])
        done |= survey.seen[best]
    return tuple(chosen), _share(done, np.asarray(survey.seen.any(axis=0)))


def covered_share(mesh: Mesh, frusta: Sequence[Frustum], seed: int = 0) -> float:
    """Return the share of the surface that these frusta see, of what they and the greedy candidates can see."""
    survey = _survey(mesh, seed)
    own = [_covered(survey.caster, frustum, survey.points, survey.normals) for frustum in frusta]
    done = np.any(own, axis=0)
    return _share(done, survey.seen.any(axis=0) | done)


@dataclass(frozen=True, eq=False)
class _Survey:
    """Points (N, 3) of a mesh with normals, and which candidates (C) see which of them (C, N)."""

    caster: MeshCaster
    points: Array
    normals: Array
    candidates: list[Frustum]
    seen: Array


def _survey(mesh: Mesh, seed: int) -> _Survey:
    caster, rng = MeshCaster(mesh), np.random.default_rng(seed)
    points, normals = _surface_points(mesh, caster, rng)
    candidates = _candidates(mesh, points, normals, rng)
    seen = np.stack([_covered(caster, frustum, points, normals) for frustum in candidates])
    return _Survey(caster, points, normals, candidates, seen)


def _share(done: Array, reachable: Array) -> float:
    return float(done.sum() / max(int(reachable.sum()), 1))


def _sphere(mesh: Mesh) -> tuple[Array, float]:
    middle = 0.5 * (mesh.vertices.min(axis=0) + mesh.vertices.max(axis=0))
    radius = float(np.linalg.norm(mesh.vertices - middle, axis=1).max())
    if not radius > 0:
        raise ValueRangeError("all vertices of the mesh are one point; there is nothing to look at")
    return middle, radius


def _outside(middle: Array, radius: float, direction: Array, distance: float) -> Frustum:
    up = (0.0, 0.0, 1.0) if abs(direction[2]) < 0.9 else (0.0, 1.0, 0.0)
    fov = 2.02 * np.degrees(np.arcsin(1.0 / distance))
    return Frustum(eye=_vector(middle + distance * radius * direction), target=_vector(middle), up=up, fov=float(fov))


def _surface_points(mesh: Mesh, caster: MeshCaster, rng: np.random.Generator) -> tuple[Array, Array]:
    """Points (N, 3) spread by area, and unit normals."""
    area = np.linalg.norm(face_normals(mesh.vertices, mesh.faces), axis=1)
    face = rng.choice(len(area), POINTS, p=area / area.sum())
    a, b = np.sqrt(rng.random(POINTS))[:, None], rng.random(POINTS)[:, None]
    three = mesh.vertices[mesh.faces[face]]
    points = (1 - a) * three[:, 0] + a * (1 - b) * three[:, 1] + a * b * three[:, 2]
    return points, caster.flat_normals[face].astype(np.float64)


def _candidates(mesh: Mesh, points: Array, normals: Array, rng: np.random.Generator) -> list[Frustum]:
    middle, radius = _sphere(mesh)
    number = np.arange(FAR) + 0.5
    z, yaw = 1.0 - 2.0 * number / FAR, number * np.pi * (3.0 - np.sqrt(5.0))
    ring = np.sqrt(1.0 - z * z)
    directions = np.concatenate([np.eye(3), -np.eye(3), np.stack([ring * np.cos(yaw), ring * np.sin(yaw), z], axis=1)])
    found = [_outside(middle, radius, direction, 2.5) for direction in directions]
    for k in rng.choice(len(points), NEAR, replace=False):
        up = (0.0, 0.0, 1.0) if abs(normals[k, 2]) < 0.9 else (0.0, 1.0, 0.0)
        eye = _vector(points[k] + 0.6 * radius * normals[k])
        found.append(Frustum(eye=eye, target=_vector(points[k]), up=up, fov=60.0))
    return found


def _covered(caster: MeshCaster, frustum: Frustum, points: Array, normals: Array) -> Array:
    """(N,) bool: which points a frustum sees, not too much from the side."""
    camera = frustum.camera(2)
    local = points @ camera.R.T + camera.t
    with np.errstate(divide="ignore", invalid="ignore"):
        x, y = (local[:, :2] / local[:, 2:] @ camera.K[:2, :2].T + camera.K[:2, 2]).T
    directions = points - camera.center
    length = np.linalg.norm(directions, axis=1)
    inside = (local[:, 2] > 0) & (x > 0) & (x < 2) & (y > 0) & (y < 2)
    facing = -(directions * normals).sum(axis=1)
    inside &= (-facing if _is_within(caster, camera) else facing) > FACING * length
    seen = np.zeros(len(points), bool)
    if inside.any():
        seen[inside] = caster.cast(camera.center, directions[inside]).t > 1.0 - 1e-3
    return seen


def _is_within(caster: MeshCaster, camera: Camera) -> bool:
    """Whether most of what is met by a few rays of the view is met from inside the mesh."""
    hits = caster.cast_camera(camera)
    along = np.where(hits.face >= 0, (hits.normal * camera.pixel_rays()).sum(axis=-1), 0.0)
    return bool((along > 0).sum() > (along < 0).sum())
