"""What Open3D does for ibrpipe, and how smaller packages do it: CPU seconds, and errors against the exact surface.

pip install embreex fast-simplification libigl point-cloud-utils
python docs/figures/open3d_peers.py
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np

from ibrpipe.embree import MeshCaster
from ibrpipe.io.surfaces.meshes import read_mesh, write_mesh
from ibrpipe.modelling.rectangles import _box_axes
from ibrpipe.native_imports import import_open3d, import_pycolmap
from ibrpipe.reconstruction.surface.mesh_operations import openings, simplified
from ibrpipe.synthetic.scene import prepare_scene
from ibrpipe.synthetic.scenes import make_scene
from ibrpipe.types import Array, Camera, Mesh

POINTS = 100_000
#: noise of the points for Poisson, shares of the diagonal
NOISE = 0.001
OCTREE = 8


def say(text: str) -> None:
    """Write a line at once."""
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


def timed(call: Callable[[], Any]) -> tuple[Any, float]:
    """Return what a call returns, and the CPU seconds of the fastest of three."""
    best = np.inf
    for _ in range(3):
        began = process_time()
        found = call()
        best = min(best, process_time() - began)
    return found, best


def rays(mesh: Mesh) -> None:
    """Nearest hits of the 307,200 rays of a picture."""
    import point_cloud_utils
    from embreex.mesh_construction import TriangleMesh
    from embreex.rtcore_scene import EmbreeScene

    middle, size = mesh.vertices.mean(axis=0), float(np.linalg.norm(np.ptp(mesh.vertices, axis=0)))
    camera = Camera.look_at(middle + size * np.array([0.5, -1.0, 0.4]), middle, width=640, height=480)
    directions = np.ascontiguousarray(camera.pixel_rays().reshape(-1, 3), np.float32)
    origins = np.ascontiguousarray(np.broadcast_to(camera.center, directions.shape), np.float32)
    caster = MeshCaster(mesh)
    caster.cast_camera(camera)
    wanted, ours = timed(lambda: caster.cast(camera.center, directions).t)
    scene = EmbreeScene()
    corners, faces = mesh.vertices.astype(np.float32), mesh.faces.astype(np.int32)
    TriangleMesh(scene, corners, faces)
    scene.run(origins[:1], directions[:1])
    found, embreex = timed(lambda: scene.run(origins, directions, output=1)["tfar"])
    other = point_cloud_utils.RayMeshIntersector(corners, faces)
    again, utils = timed(lambda: other.intersect_rays(origins, directions)[2])
    say(f"  rays: Open3D {ours:.3f} s, embreex {embreex:.3f} s, point-cloud-utils {utils:.3f} s")
    for name, t in (("embreex", found), ("point-cloud-utils", again)):
        hit = np.isfinite(wanted)
        apart = np.where(hit, np.abs(np.asarray(t)[: len(wanted)] / np.where(hit, wanted, 1) - 1) > 1e-4, False)
        say(f"    {name}: {100 * apart.mean():.3f} % of the hits lie elsewhere")


def points_of(mesh: Mesh) -> tuple[Array, Array]:
    """Noisy points of a surface and their normals."""
    rng = np.random.default_rng(0)
    corners = mesh.vertices[mesh.faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(normal, axis=1)
    face = rng.choice(len(area), POINTS, p=area / area.sum())
    a, b = rng.random((2, POINTS, 1))
    flip = a + b > 1
    a, b = np.where(flip, 1 - a, a), np.where(flip, 1 - b, b)
    places = corners[face, 0] * (1 - a - b) + corners[face, 1] * a + corners[face, 2] * b
    noise = NOISE * np.linalg.norm(np.ptp(mesh.vertices, axis=0))
    return places + noise * rng.normal(size=places.shape), normal[face] / area[face, None]


def poisson(mesh: Mesh) -> None:
    """A surface of noisy points, one thread."""
    o3d, pycolmap = import_open3d(), import_pycolmap()
    position, normal = points_of(mesh)
    points = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(position))
    points.normals = o3d.utility.Vector3dVector(normal)

    def by_open3d() -> Mesh:
        made, _ = o3d.geometry.TriangleMesh.create_from_point_cloud_poisson(points, depth=OCTREE, n_threads=1)
        return Mesh(np.asarray(made.vertices), np.asarray(made.triangles, dtype=np.int32))

    with tempfile.TemporaryDirectory() as folder:
        given, out = Path(folder) / "points.ply", Path(folder) / "mesh.ply"
        _write_points(given, position, normal)

        def by_pycolmap() -> Mesh:
            options = pycolmap.PoissonMeshingOptions(depth=OCTREE, trim=0.0, num_threads=1, color=False)
            pycolmap.poisson_meshing(given, out, options)
            return read_mesh(out)

        for name, made, seconds in (
            ("Open3D", *timed(by_open3d)),
            ("pycolmap", *timed(by_pycolmap)),
        ):
            say(f"  Poisson: {name} {seconds:.2f} s, {len(made.faces)} faces, {_error(mesh, made)}")


def _write_points(path: Path, position: Array, normal: Array) -> None:
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(position)}\n"
    head += "".join(f"property float {name}\n" for name in ("x", "y", "z", "nx", "ny", "nz"))
    head += "".join(f"property uchar {name}\n" for name in ("red", "green", "blue")) + "end_header\n"
    row = np.zeros(len(position), [("p", "<f4", 3), ("n", "<f4", 3), ("c", "u1", 3)])
    row["p"], row["n"] = position, normal
    path.write_bytes(head.encode() + row.tobytes())


def _error(true: Mesh, made: Mesh) -> str:
    """Distances of the true vertices to a surface, shares of the diagonal; and of its border to the true one."""
    near, _ = MeshCaster(made).closest(true.vertices)
    away = np.linalg.norm(near - true.vertices, axis=1) / np.linalg.norm(np.ptp(true.vertices, axis=0))
    border = openings(true).length
    kept = f", border {100 * openings(made).length / border:.1f} %" if border else ""
    return f"distance mean {1e4 * away.mean():.3f}e-4, 99 % {1e4 * np.quantile(away, 0.99):.2f}e-4{kept}"


def simplification(mesh: Mesh) -> None:
    """A tenth of the triangles."""
    import fast_simplification
    import igl

    pycolmap, wanted = import_pycolmap(), len(mesh.faces) // 10
    corners = mesh.vertices[mesh.faces]
    area = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum()
    edge = float(np.sqrt(area / (0.433 * wanted)))

    def by_fast() -> Mesh:
        vertices, faces = fast_simplification.simplify(mesh.vertices, mesh.faces, target_reduction=0.9)
        return Mesh(np.asarray(vertices, np.float64), np.asarray(faces, np.int32))

    def by_igl() -> Mesh:
        found = igl.qslim(mesh.vertices, mesh.faces.astype(np.int64), wanted)
        return Mesh(np.asarray(found[0]), np.asarray(found[1], np.int32))

    with tempfile.TemporaryDirectory() as folder:
        given, out = Path(folder) / "mesh.ply", Path(folder) / "small.ply"
        write_mesh(mesh, given)

        def by_pycolmap() -> Mesh:
            options = pycolmap.MeshSimplificationOptions(target_face_ratio=0.1, boundary_weight=4.0, num_threads=1)
            pycolmap.simplify_mesh(given, out, options)
            return read_mesh(out)

        ways = {"Open3D": lambda: simplified(mesh, edge), "pycolmap": by_pycolmap}
        for name, way in {**ways, "fast-simplification": by_fast, "libigl": by_igl}.items():
            try:
                made, seconds = timed(way)
            except Exception as error:
                say(f"  simplification: {name} fails: {type(error).__name__} {error}")
                continue
            say(f"  simplification: {name} {seconds:.2f} s, {len(made.faces)} faces, {_error(mesh, made)}")


def box(mesh: Mesh) -> None:
    """The smallest box around a mesh's outermost points, as rectangles.py asks for it."""
    import trimesh

    directions = np.random.default_rng(0).normal(size=(500, 3))
    outermost = mesh.vertices[np.unique((mesh.vertices @ directions.T).argmax(axis=0))]
    axes, ours = timed(lambda: _box_axes(outermost))
    (_, extents), theirs = timed(lambda: trimesh.bounds.oriented_bounds(outermost))
    volume = "none" if axes is None else f"{np.prod(np.ptp(outermost @ axes.T, axis=0)):.5f}"
    say(f"  box: Open3D {ours:.3f} s, volume {volume}; trimesh {theirs:.3f} s, {np.prod(extents):.5f}")


def main() -> None:
    """Compare on the meshes of two built-in scenes."""
    for scene in ("lambert", "glossy"):
        mesh = prepare_scene(make_scene(scene, 2.0), occlusion_rays=0).caster.mesh
        say(f"{scene}: {len(mesh.faces)} triangles")
        for part in (rays, box, simplification, poisson):
            part(mesh)


if __name__ == "__main__":
    main()
