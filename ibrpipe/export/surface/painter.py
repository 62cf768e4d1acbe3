"""Textured meshes as other programs draw them: nearest front where the colour's alpha is above the cut, unlit."""

from __future__ import annotations

import io
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ibrpipe.core.color import srgb_decode
from ibrpipe.embree import MeshCaster
from ibrpipe.io.surfaces.gltf_file import GltfFile
from ibrpipe.renderers.antialiasing import supersample
from ibrpipe.types import Array, Camera, Frame, Mesh

#: least alpha that is shown
CUT = 0.5
#: rays that are followed through all surfaces at once
_BLOCK = 1 << 17


@dataclass(frozen=True, eq=False)
class TexturedMesh:
    """A mesh in the world with one picture.

    Attributes
    ----------
    mesh : Mesh
    uv : (V, 2) float64, v downward
    texture : (h, w, 4) float32, linear colour and alpha
    """

    mesh: Mesh
    uv: Array
    texture: Array

    def facing(self, eye: Array) -> Array:
        """Return the faces (N,) whose fronts a point sees, whatever lies between."""
        a, b, c = (self.mesh.vertices[self.mesh.faces[:, corner]] for corner in range(3))
        return np.flatnonzero((np.cross(b - a, c - a) * (eye - a)).sum(axis=1) > 0)


def read_back(path: Path, gltf_from_world: Array) -> TexturedMesh:
    """Read a file that :mod:`ibrpipe.export.surface.gltf` wrote, and move it back into the world."""
    file = GltfFile(path)
    primitive = file.json["meshes"][0]["primitives"][0]
    attributes = primitive["attributes"]
    places = file.values(attributes["POSITION"]).astype(np.float64)
    inverse = np.linalg.inv(gltf_from_world)
    faces = file.values(primitive["indices"]).reshape(-1, 3).astype(np.int32)
    uv = file.values(attributes["TEXCOORD_0"]).astype(np.float64)
    material: Mapping[str, Any] = file.json["materials"][primitive["material"]]
    index = material["pbrMetallicRoughness"]["baseColorTexture"]["index"]
    texture: Mapping[str, Any] = file.json["textures"][index]
    source = texture.get("extensions", {}).get("EXT_texture_webp", texture)["source"]
    picture = decode(file.view(file.json["images"][source]["bufferView"]))
    return TexturedMesh(Mesh(places @ inverse[:3, :3].T + inverse[:3, 3], faces), uv, picture)


def decode(content: bytes) -> Array:
    """(h, w, 4) float32, linear colour and alpha of a coded picture."""
    from PIL import Image

    with Image.open(io.BytesIO(content)) as image:
        pixels = np.asarray(image.convert("RGBA"), np.float32) / 255.0
    pixels[..., :3] = srgb_decode(pixels[..., :3])
    return pixels


def paint(source: TexturedMesh, camera: Camera, samples: int) -> Frame:
    """Draw a textured mesh: colour and alpha of `samples` rays a pixel."""

    def draw(view: Camera, _: tuple[str, ...]) -> Frame:
        rgba = _cast(source, view)
        return Frame(rgba[..., :3], None, rgba[..., 3])

    return supersample(draw, camera, ("color", "alpha"), samples)


def _cast(source: TexturedMesh, camera: Camera) -> Array:
    """(H, W, 4) float32: linear colour, and 1 where something is hit."""
    rays = camera.pixel_rays().reshape(-1, 3)
    out = np.zeros((len(rays), 4), np.float32)
    fronts = source.facing(camera.center)
    if not len(fronts):
        return out.reshape(camera.height, camera.width, 4)
    # backs are left out beforehand: rays that are to pass a back may miss a front that lies on it
    caster = MeshCaster(Mesh(source.mesh.vertices, source.mesh.faces[fronts]))
    hits = caster.cast(camera.center, rays)
    met = np.flatnonzero(hits.face >= 0)
    color = _lookup(source, fronts[hits.face[met]], hits.uv[met])
    shown = color[:, 3] >= CUT
    out[met[shown], :3], out[met[shown], 3] = color[shown, :3], 1.0
    masked = met[~shown]
    for start in range(0, len(masked), _BLOCK):
        rest = masked[start : start + _BLOCK]
        ray, more = caster.cast_all(np.broadcast_to(camera.center, (len(rest), 3)), rays[rest])
        color = _lookup(source, fronts[more.face], more.uv)
        shown = color[:, 3] >= CUT
        found, first = np.unique(ray[shown], return_index=True)
        out[rest[found], :3], out[rest[found], 3] = color[shown, :3][first], 1.0
    return out.reshape(camera.height, camera.width, 4)


def _lookup(source: TexturedMesh, face: Array, weights: Array) -> Array:
    """(N, 4) colour and alpha, bilinear, clamped at the picture's edge."""
    corners = source.uv[source.mesh.faces[face]]
    first = 1.0 - weights.sum(axis=1, keepdims=True)
    uv = corners[:, 0] * first + corners[:, 1] * weights[:, :1] + corners[:, 2] * weights[:, 1:]
    height, width = source.texture.shape[:2]
    x, y = uv[:, 0] * width - 0.5, uv[:, 1] * height - 0.5
    left, top = np.floor(x).astype(np.int64), np.floor(y).astype(np.int64)
    s, t = (x - left)[:, None].astype(np.float32), (y - top)[:, None].astype(np.float32)
    i, k = np.clip(left, 0, width - 1), np.clip(left + 1, 0, width - 1)
    j, m = np.clip(top, 0, height - 1), np.clip(top + 1, 0, height - 1)
    picture = source.texture
    upper = (1 - s) * picture[j, i] + s * picture[j, k]
    return (1 - t) * upper + t * ((1 - s) * picture[m, i] + s * picture[m, k])
