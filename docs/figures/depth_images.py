"""Pictures of the page on depth images: where they stand round a mesh, and the mesh beside what they show of it.

python docs/figures/depth_images.py MESH; written to docs/images; without the file it says so and makes nothing.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from relief import GROUND, IMAGES, picture, write

import ibrpipe
from ibrpipe.io.surfaces.colored_meshes import read_colored
from ibrpipe.modelling.depth_images import depth_images_asset
from ibrpipe.modelling.frusta import Frustum, greedy_frusta
from ibrpipe.modelling.mesh_colors import clay
from ibrpipe.types import Array, Camera, Light, Lighting, Mesh, PaintedMesh, Part, Scene

#: colours of the frusta, one after another
TINTS = ((0.75, 0.1, 0.08), (0.08, 0.35, 0.7), (0.1, 0.5, 0.15), (0.7, 0.45, 0.03), (0.45, 0.12, 0.6), (0.05, 0.5, 0.5))
#: unlit: colours are as they are painted
PLAIN = Lighting(np.ones(3), (Light(np.array([0.0, 0.0, 1.0]), np.zeros(3)),))


def bar(start: Array, end: Array, width: float, tint: tuple[float, float, float]) -> PaintedMesh:
    """A thin box from one point to another."""
    along = (end - start) / np.linalg.norm(end - start)
    side = np.cross(along, np.eye(3)[np.argmin(np.abs(along))])
    side *= width / np.linalg.norm(side)
    ring = [side, np.cross(along, side), -side, -np.cross(along, side)]
    places = np.array([*(start + each for each in ring), *(end + each for each in ring)])
    faces = [three for k in range(4) for three in ((k, (k + 1) % 4, k + 4), ((k + 1) % 4, (k + 1) % 4 + 4, k + 4))]
    return PaintedMesh(Mesh(places, np.array(faces)), np.tile(np.float32(tint), (8, 1)))


def pyramid(frustum: Frustum, reach: float, width: float, tint: tuple[float, float, float]) -> list[PaintedMesh]:
    """Edges of a frustum from its eye to the depth `reach`."""
    camera = frustum.camera(2)
    corners = camera.center + reach * camera.pixel_rays(np.array([[0, 0], [2, 0], [2, 2], [0, 2]], float))
    edges = [(camera.center, corner) for corner in corners]
    edges += [(corners[k], corners[(k + 1) % 4]) for k in range(4)]
    return [bar(start, end, width, tint) for start, end in edges]


def placement(painted: PaintedMesh, frusta: tuple[Frustum, ...], middle: Array, size: float) -> list[list[Array]]:
    """The mesh among the frusta that were placed round it, from two sides (schaufler1999, fig. 12)."""
    pieces = [painted]
    for number, frustum in enumerate(frusta):
        distance = float(np.linalg.norm(np.array(frustum.eye) - frustum.target))
        pieces += pyramid(frustum, distance, 0.005 * size, TINTS[number % len(TINTS)])
    scene = ibrpipe.prepare(Scene([Part("all", tuple(pieces))], "all", PLAIN), "hierarchical")
    ways = ((1.0, 0.5, 1.0), (-0.4, 1.1, -0.8))
    views = [Camera.look_at(middle + 2.1 * size * np.array(way), middle, (0, 1, 0), 38, 330, 260) for way in ways]
    return [[picture(scene, view, "hierarchical", mode="polygons") for view in views]]


def main() -> None:
    """Make both pictures."""
    files = [Path(word) for word in sys.argv[1:2]]
    if not files or not files[0].is_file():
        sys.exit(f"no pictures of depth images: {files[0] if files else 'MESH'} missing")
    IMAGES.mkdir(exist_ok=True)
    mesh, colors = read_colored(files[0])
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    middle, size = 0.5 * (low + high), float(np.linalg.norm(high - low))
    frusta, _ = greedy_frusta(mesh, 6)
    normals = np.zeros_like(mesh.vertices)
    turned = np.cross(*(mesh.vertices[mesh.faces[:, k]] - mesh.vertices[mesh.faces[:, 0]] for k in (1, 2)))
    np.add.at(normals, mesh.faces.ravel(), np.repeat(turned, 3, axis=0))
    shades = clay(normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30))
    painted = PaintedMesh(mesh, shades)
    write("depth-images-frusta.png", placement(painted, frusta, middle, size))
    maps = ibrpipe.prepare(depth_images_asset(mesh, greedy_frusta(mesh, 16)[0], 512, files[0].name, colors), "epipolar")
    own = ibrpipe.prepare(Scene([Part("all", (painted,))], "all", PLAIN), "hierarchical")
    rows = []
    for way in ((0.3, 0.35, 1.0), (-1.0, 0.4, 0.5)):
        eye = middle + 1.3 * size * np.array(way) / np.linalg.norm(way)
        view = Camera.look_at(eye, middle, (0, 1, 0), 38, 330, 240)
        rows.append([picture(own, view, "hierarchical", mode="polygons"), picture(maps, view, "epipolar")])
        error = np.abs(rows[-1][0] - rows[-1][1]).mean(axis=2)
        shown = (rows[-1][0] != GROUND).any(axis=2)
        sys.stdout.write(f"{100 * (error[shown] > 0.1).mean():.1f} % of the object's pixels are off by over 0.1\n")
    write("depth-images-warp.png", rows)


if __name__ == "__main__":
    main()
