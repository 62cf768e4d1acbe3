"""Parts of scenes as atlases of impostors: orthographic pictures from an octahedral map of directions and six sides.

Game engines draw such an atlas as a quad that faces the viewer, blended between the nearest directions.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ibrpipe.core.color import srgb_decode, to_bytes
from ibrpipe.embree import MeshCaster
from ibrpipe.errors import ConfigError, ResourceError
from ibrpipe.export.asset_folders import found_asset, name_of
from ibrpipe.export.impostor_sample import sample_files
from ibrpipe.export.ply import vertices_of
from ibrpipe.export.registry import Exporter
from ibrpipe.export.surface.source import read_exported
from ibrpipe.io.documents.impostors import Impostors, ImpostorView
from ibrpipe.io.manifest import write_text
from ibrpipe.io.photos.images import write_exr, write_png
from ibrpipe.io.scenes import read_scene
from ibrpipe.synthetic.instanced.pieces import joined
from ibrpipe.types import Array, Mesh, PaintedMesh, Part, Scene

INDEX = "impostors.json"
#: cells along a side of the octahedral map, texels along a side of a cell, rays along a side of a texel
GRID, TEXELS, RAYS = 8, 128, 3
#: triangles of a part at the most, its copies taken apart
MOST_POLYGONS = 4_000_000
#: polygons above which a group of copies is taken apart
_GROUP = 250_000
_SIDES = np.array([(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)], np.float64)


@dataclass(frozen=True, eq=False)
class Picture:
    """One view: albedo (T, T, 3), coverage (T, T), normal (T, T, 3), depth (T, T); float32."""

    albedo: Array
    cover: Array
    normal: Array
    depth: Array


def write(source: Path, target: Path) -> str:
    """Write an atlas for every part that the scene's root holds copies of, each in a folder of its own in `target`.

    Groups of many, such as groves of trees, are taken apart: theirs are the atlases of what they hold. An asset, or a
    run's asset, is one part: its samples joined by triangles, in the mean colours that photos see. ``index.html`` shows
    the atlases in three.js.

    Returns
    -------
    str
        How to see them.

    Raises
    ------
    ConfigError
        None of them has meshes, or one has more than `MOST_POLYGONS`.
    ResourceError
        A file cannot be written.
    """
    asset = found_asset(source)
    scene = read_scene(source) if asset is None else asset_scene(asset)
    names = held_parts(scene, scene.root) or [scene.root]
    shown = [name for name in names if scene.polygons[name]]
    if not shown:
        raise ConfigError(f"{source}: what its root holds has no meshes, so there are no impostors to make")
    for name in shown:
        if scene.polygons[name] > MOST_POLYGONS:
            raise ConfigError(
                f"{source}: part {name!r} has {scene.polygons[name]:,} polygons with its copies; impostors are made of "
                f"at most {MOST_POLYGONS:,}; let the root hold copies of smaller parts"
            )
    try:
        folders = dict(zip(shown, folder_names(shown), strict=True))
        for name, plain in folders.items():
            folder = target / plain
            folder.mkdir(parents=True, exist_ok=True)
            write_atlas(scene, name, folder)
        title = source.resolve().stem if asset is None else name_of(asset)
        for file, text in sample_files(title, folders).items():
            write_text(target / file, text)
    except OSError as error:
        if isinstance(error, ResourceError):
            raise
        raise ResourceError(f"{target}: cannot write: {error.strerror or error}") from error
    return f"{len(shown)} parts; to see them: npm install three, a server, and a browser, as {target}/index.html says"


def asset_scene(asset: Path) -> Scene:
    """Return an asset folder as a scene of one part: the samples that photos see, joined by triangles.

    Raises
    ------
    MissingFileError, FormatError
        The asset is missing, damaged, or shows nothing.
    """
    table, faces = vertices_of(read_exported(asset), wanted=True)
    places, color = (np.stack([table[axis] for axis in axes], axis=1) for axes in ("xyz", ("red", "green", "blue")))
    painted = PaintedMesh(Mesh(places, faces), srgb_decode(color.astype(np.float32) / 255.0))
    name = name_of(asset)
    return Scene([Part(name, (painted,))], name)


def held_parts(scene: Scene, name: str) -> list[str]:
    """Parts that a part holds copies of, once each; groups of more than 250,000 polygons are taken apart."""
    found = []
    waiting, met = [name], {name}
    while waiting:
        inner = waiting.pop()
        part = scene.parts[inner]
        if inner == name or (scene.polygons[inner] > _GROUP and part.children and not part.meshes):
            held = [each for each in dict.fromkeys(copies.part for copies in part.children) if each not in met]
            met.update(held)
            waiting += reversed(held)
        else:
            found.append(inner)
    return found


def folder_names(parts: list[str]) -> list[str]:
    """Return names of folders, one for every part: plain letters, no leading dot, none twice (capitals aside)."""
    found: dict[str, str] = {}
    for part in parts:
        plain = re.sub(r"[^A-Za-z0-9._-]+", "-", part).lstrip(".").strip("-")[:80].rstrip(".") or "part"
        name, number = plain, 1
        while name.lower() in found:
            number += 1
            name = f"{plain}-{number}"
        found[name.lower()] = name
    return list(found.values())


def write_atlas(
    scene: Scene, name: str, folder: Path, grid: int = GRID, texels: int = TEXELS, rays: int = RAYS
) -> Impostors:
    """Write the atlas of one part; see `Impostors`. ``impostors.json`` is written last."""
    from PIL import Image

    painted = joined(scene.flattened(name))
    center = 0.5 * (painted.mesh.vertices.min(axis=0) + painted.mesh.vertices.max(axis=0))
    radius = float(np.linalg.norm(painted.mesh.vertices - center, axis=1).max()) or 1.0
    axes = view_axes(np.concatenate([octahedral_directions(grid), _SIDES]))
    caster = MeshCaster(painted.mesh)
    cells = [(n // grid, n % grid) for n in range(grid * grid + len(_SIDES))]
    height = (cells[-1][0] + 1) * texels
    albedo, normal = (np.zeros((height, grid * texels, 3), np.float32) for _ in range(2))
    cover, depth = (np.full((height, grid * texels), fill, np.float32) for fill in (0.0, np.inf))
    for (row, column), view in zip(cells, axes, strict=True):
        picture = cast_view(caster, painted, view, center, radius, texels, rays)
        place = np.s_[row * texels : (row + 1) * texels, column * texels : (column + 1) * texels]
        albedo[place], normal[place] = picture.albedo, picture.normal
        cover[place], depth[place] = picture.cover, picture.depth
    write_png(folder / "albedo.png", albedo, cover)
    write_exr(folder / "normal.exr", normal)
    write_exr(folder / "depth.exr", {"Z": depth})
    Image.fromarray(to_bytes(0.5 * normal + 0.5)).save(folder / "normal.png")
    Image.fromarray(depth_bytes(depth, radius)).save(folder / "depth.png")
    views = [
        ImpostorView(column=column, row=row, direction=view[2].tolist(), right=view[0].tolist(), up=view[1].tolist())
        for (row, column), view in zip(cells, axes, strict=True)
    ]
    document = Impostors(
        part=name, center=center.tolist(), radius=radius, texels=texels, grid=grid,
        albedo="albedo.png", normal="normal.exr", depth="depth.exr", normal_png="normal.png",
        depth_png="depth.png", views=views,
    )  # fmt: skip
    write_text(folder / INDEX, document.to_json() + "\n")
    return document


def depth_bytes(depth: Array, radius: float) -> Array:
    """Return depths (H, W), 0 to 2 `radius` or inf, as a picture's bytes (H, W, 3): high, low, covered."""
    covered = np.isfinite(depth)
    share = np.where(covered, depth, 0.0) / (2.0 * radius)
    codes = np.round(65535 * np.clip(share, 0.0, 1.0)).astype(np.int64)
    return np.stack([codes >> 8, codes & 255, 255 * covered], axis=-1).astype(np.uint8)


def octahedral_directions(grid: int) -> Array:
    """Unit directions (grid * grid, 3) of an octahedral map, corners included, row by row (cigolle2014)."""
    v, u = np.meshgrid(*2 * [np.linspace(-1.0, 1.0, grid)], indexing="ij")
    z = 1.0 - np.abs(u) - np.abs(v)
    below = np.maximum(-z, 0.0)
    x, y = u - below * np.where(u >= 0, 1.0, -1.0), v - below * np.where(v >= 0, 1.0, -1.0)
    found = np.stack([x, y, z], axis=-1).reshape(-1, 3)
    return found / np.linalg.norm(found, axis=1, keepdims=True)


def view_axes(directions: Array) -> Array:
    """Axes (N, 3, 3), rows right, up, towards the viewer; up is nearest to z, or to y where that is the view."""
    upright = np.where(np.abs(directions[:, 2:]) < 0.999, (0.0, 0.0, 1.0), (0.0, 1.0, 0.0))
    right = np.cross(upright, directions)
    right /= np.linalg.norm(right, axis=1, keepdims=True)
    return np.stack([right, np.cross(directions, right), directions], axis=1)


def cast_view(
    caster: MeshCaster, painted: PaintedMesh, view: Array, center: Array, radius: float, texels: int, rays: int
) -> Picture:
    """Cast rays x rays parallel rays for every texel; means of those that hit, depth that of the nearest."""
    side = texels * rays
    steps = (2.0 * np.arange(side) + 1.0) / side - 1.0
    across, down = np.meshgrid(steps, steps)
    origins = center + radius * (across[..., None] * view[0] - down[..., None] * view[1] + view[2])
    hits = caster.cast(origins, np.broadcast_to(-view[2], origins.shape))
    hit = hits.face >= 0
    corners = painted.color[painted.mesh.faces[np.where(hit, hits.face, 0)]]
    weights = np.stack([1.0 - hits.uv.sum(axis=-1), hits.uv[..., 0], hits.uv[..., 1]], axis=-1)
    color = np.einsum("yxc,yxcd->yxd", weights, corners)
    normal = hits.normal * np.where((hits.normal @ view[2]) < 0, -1.0, 1.0)[..., None]
    blocks = (texels, rays, texels, rays)
    count = hit.reshape(blocks).sum(axis=(1, 3))
    albedo, turned = (
        np.where(hit[..., None], each, 0.0).reshape(*blocks, 3).sum(axis=(1, 3)) for each in (color, normal)
    )
    length = np.linalg.norm(turned, axis=-1, keepdims=True)
    depth = np.where(hit, hits.t, np.inf).reshape(blocks).min(axis=(1, 3))
    return Picture(
        (albedo / np.maximum(count, 1)[..., None]).astype(np.float32),
        (count / rays**2).astype(np.float32),
        (turned / np.where(length > 0, length, 1.0)).astype(np.float32),
        depth.astype(np.float32),
    )


EXPORTER = Exporter(
    "impostors", "Octahedral and six-sided impostors of an asset or of a scene's parts, for game engines.", write,
    takes="any", folders=("impostors",),
)  # fmt: skip
