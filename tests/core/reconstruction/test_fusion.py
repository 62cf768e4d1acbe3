"""Fusion, volume and surface-net kernels against their plain twins, on three noisy maps of two slanted planes."""

from __future__ import annotations

import numba
import numpy as np
import pytest
import surface_twin as twin

from ibrpipe.core.reconstruction.fusion import fuse_view
from ibrpipe.core.reconstruction.surface_nets import SIDE
from ibrpipe.core.reconstruction.tsdf import integrate, observe, silhouettes
from ibrpipe.reconstruction.depth.fusion import FusionRules
from ibrpipe.reconstruction.depth.map_store import LoadedMap, pack, packed_cameras
from ibrpipe.reconstruction.surface.tsdf import blocks_of, extract
from ibrpipe.types import Camera


def _maps(seed: int = 0, size: tuple[int, int] = (14, 18)) -> list[LoadedMap]:
    """Depth of a roof seen by three cameras, with noise, holes and outliers."""
    draw = np.random.default_rng(seed)
    maps = []
    for number, eye in enumerate(((0.0, 0.0, -4.0), (0.8, 0.1, -4.1), (-0.7, 0.3, -3.8))):
        camera = Camera.look_at(eye, (0, 0, 0), (0, 1, 0), 30.0, size[1], size[0])
        y, x = np.mgrid[: size[0], : size[1]] + 0.5
        rays = np.stack([x, y, np.ones_like(x)], axis=-1) @ camera.world_from_pixel.T
        side = np.sign(x - size[1] / 2)[..., None]
        normal = np.where(side > 0, (0.3, 0.1, -1.0), (-0.3, 0.1, -1.0))
        normal /= np.linalg.norm(normal, axis=2, keepdims=True)
        depth = -(normal @ camera.center) / (rays * normal).sum(axis=2)
        depth = depth * (1 + 0.002 * draw.normal(size=size))
        depth[draw.random(size) < 0.1] = 0
        depth = np.where(draw.random(size) < 0.1, depth * draw.choice((0.8, 1.2), size), depth)
        confidence = draw.uniform(0, 1, size)
        kinds = (depth, normal, confidence, np.ones(size))
        maps.append(LoadedMap(str(number), camera, *(array.astype(np.float32) for array in kinds)))
    return maps


def _fused(maps: list[LoadedMap], rules: FusionRules) -> tuple[np.ndarray, ...]:
    p, shape = pack(maps), maps[0].depth.shape
    used = np.zeros(len(p.depth), np.uint8)
    mean, normal = np.empty((*shape, 2), np.float32), np.empty((*shape, 3), np.float32)
    votes = np.empty((*shape, 2), np.int32)
    fuse_view(p.depth, p.normal, p.confidence, p.cameras, rules.packed(), used, mean, normal, votes)
    return mean, normal, votes, used


@pytest.mark.parametrize("rules", [FusionRules(), FusionRules(0.3, 0.004, 20.0, 3)])
def test_fusion_is_that_of_its_twin(rules: FusionRules) -> None:
    maps = _maps()
    mean, normal, votes, used = _fused(maps, rules)
    marks = [np.zeros(each.depth.shape, int) for each in maps]
    wanted = twin.fuse_view(maps, rules, marks)
    assert np.array_equal(votes, wanted[2])
    assert np.allclose(mean, wanted[0], atol=1e-6, rtol=1e-6)
    assert np.allclose(normal, wanted[1], atol=1e-6)
    assert np.array_equal(used, np.concatenate([mark.ravel() for mark in marks]))
    assert 0.5 < (votes[..., 0] >= 2).mean() < 1.0
    assert (votes[..., 1] > 0).any() or rules.votes > 2


def test_the_thread_count_changes_no_byte() -> None:
    one, before = _maps(1), numba.get_num_threads()
    try:
        results = []
        for threads in (1, before):
            numba.set_num_threads(threads)
            results.append(_fused(one, FusionRules()))
    finally:
        numba.set_num_threads(before)
    for first, second in zip(*results):
        assert first.tobytes() == second.tobytes()


def test_distances_are_those_of_the_twin() -> None:
    maps, truncation = _maps(2), 0.3
    blocks = blocks_of(np.ones((2, 2, 1), bool), np.array([-0.813, -0.777, -0.411]), 0.0973)
    p, count = pack(maps), len(blocks.corners)
    total, free = np.zeros((count, 512, 2), np.float32), np.zeros((count, 512), np.float32)
    bound = np.full((count * 512, 2), -np.inf, np.float32)
    outline = np.concatenate([np.sin(np.arange(each.depth.size)) for each in maps]).astype(np.float32)
    focal = [each.camera.K[0, 0] for each in maps]
    integrate(
        blocks.corners, blocks.lattice(), p.depth, p.normal, p.confidence, outline, p.cameras,
        np.array([truncation, *focal]), total, free, bound,
    )  # fmt: skip
    inner = np.stack(np.meshgrid(*[np.arange(SIDE)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    points = blocks.origin + blocks.step * (blocks.corners[:, None] + inner).reshape(-1, 3)
    wanted = twin.integrate(points, maps, [each.confidence.astype(float) for each in maps], truncation)
    found = np.concatenate([total.reshape(-1, 2), free.reshape(-1, 1)], axis=1)
    same = np.abs(found - wanted).max(axis=1) < 1e-5  # not where a voxel lies on the border of a pixel
    assert same.mean() > 0.995
    assert (wanted[:, 2] > 0).any()
    shapes = [each.depth.shape for each in maps]
    outlines = [part.reshape(shape) for part, shape in zip(np.split(outline, p.starts[1:-1]), shapes)]
    limits, _ = twin.outline_bounds(points, [each.camera for each in maps], outlines)
    assert np.allclose(bound, limits, atol=1e-5)


def test_outlines_bound_points_as_the_twin_says() -> None:
    maps, draw = _maps(3), np.random.default_rng(0)
    points, cameras = draw.uniform(-1.5, 1.5, (300, 3)), [each.camera for each in maps]
    outlines = [draw.normal(size=each.depth.shape).astype(np.float32) for each in maps]
    outlines[0][:4] = np.nan
    bound, count = np.full((300, 2), -np.inf, np.float32), np.zeros(300, np.int32)
    for camera, outline in zip(cameras, outlines):
        starts, sizes = np.array([0, outline.size], np.int64), np.array([outline.shape], np.int64)
        focal, open_ = np.array([camera.K[0, 0]]), np.zeros(1, np.uint8)
        silhouettes(points, outline.ravel(), starts, sizes, packed_cameras([camera])[0], focal, open_, bound, count)
    wanted, pictures = twin.outline_bounds(points, cameras, outlines)
    assert np.array_equal(count, pictures)
    assert np.allclose(bound, wanted, atol=1e-5)
    assert len(set(count)) > 2


def test_observations_are_those_of_the_twin() -> None:
    maps, draw = _maps(4), np.random.default_rng(1)
    points, tolerance = draw.uniform(-0.6, 0.6, (400, 3)), draw.uniform(0.02, 0.2, 400)
    p = pack(maps)
    seen, through, best = np.zeros(400, np.int32), np.zeros(400, np.int32), np.zeros(400, np.float32)
    observe(points, p.depth, p.confidence, p.starts, p.sizes, p.projection, tolerance, seen, through, best)
    wanted = twin.observe(points, maps, tolerance)
    assert np.array_equal(seen, wanted[0])
    assert np.array_equal(through, wanted[1])
    assert ((best > 0) <= (seen > 0)).all()


def _dense(value: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Blocks' values of a dense array whose sides are multiples of 8, and the mesh extracted from it."""
    shape = tuple(size // SIDE for size in value.shape)
    blocks = blocks_of(np.ones(shape, bool), np.zeros(3), 1.0)
    split = value.reshape(shape[0], SIDE, shape[1], SIDE, shape[2], SIDE).transpose(0, 2, 4, 1, 3, 5)
    mesh = extract(blocks, np.ascontiguousarray(split.reshape(-1, SIDE**3), np.float32))
    return mesh.vertices, mesh.faces


def _triangles(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Corners of all triangles, each turned to begin with its least corner, sorted."""
    corners = np.round(vertices[faces], 4)
    turned = [np.roll(each, -min(range(3), key=lambda i: tuple(each[i])), axis=0).ravel() for each in corners]
    return np.array(sorted(map(tuple, turned)))


@pytest.mark.parametrize("holes", [0.0, 0.02])
def test_the_surface_net_is_that_of_its_twin(holes: float) -> None:
    draw = np.random.default_rng(0)
    i, j, k = np.mgrid[:16, :16, :8]
    value = np.hypot(np.hypot(i - 7.3, j - 8.2), 1.7 * (k - 3.6)) - 4.4
    value[draw.random(value.shape) < holes] = np.nan
    value = value.astype(np.float32)
    found, wanted = _dense(value), twin.surface_net(value.astype(float))
    assert np.allclose(_triangles(*found), _triangles(*wanted), atol=2e-4)
    assert len(found[1]) > 200


def test_the_surface_net_faces_outward_and_is_closed() -> None:
    i, j, k = np.mgrid[:24, :24, :24] - 11.5
    vertices, faces = _dense((np.sqrt(i * i + j * j + k * k) - 7.0).astype(np.float32))
    a, b, c = (vertices[faces[:, n]] - 11.5 for n in range(3))
    volume = (np.cross(a, b) * c).sum() / 6
    assert volume == pytest.approx(4 / 3 * np.pi * 7**3, rel=0.03)  # means of crossings lie inside
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    assert (np.unique(edges, axis=0, return_counts=True)[1] == 2).all()
