"""The peer: Embree casts rays at one level of instances of flattened parts, its fastest layout for forests."""

from __future__ import annotations

import os
from functools import cache
from time import process_time
from typing import Any

import numba
import numpy as np

from ibrpipe.bench.forest.embree_instances import EmbreeScene
from ibrpipe.bench.forest.packets import ROWS, packet_caster
from ibrpipe.renderers.hierarchical.nodes import OWN, Nodes
from ibrpipe.renderers.hierarchical.selection import copies_of
from ibrpipe.types import Array, Camera, Lighting

_COHERENT = 1 << 16
#: triangles up to which a part is one mesh, not copies of others
FLATTENED = 100_000


def copies_of_trees(nodes: Nodes) -> tuple[Array, Array]:
    """Nodes (N,) int32 and matrices (N, 12) of what a scene holds: what is larger than a tree is taken apart."""
    here, poses = np.array([nodes.root], np.int32), np.eye(4)[None, :3].reshape(1, 12)
    kept: list[tuple[Array, Array]] = []
    while len(here):
        large = (nodes.triangles[here] > FLATTENED) | (here == nodes.root)
        large &= nodes.copies[here + 1] > nodes.copies[here]
        kept.append((here[~large], poses[~large]))
        here, poses = copies_of(nodes, here, poses, np.flatnonzero(large))
    return np.concatenate([each for each, _ in kept]), np.concatenate([each for _, each in kept])


@cache
def _caster() -> Any:
    return packet_caster()


class Peer:
    """A scene as Embree takes it: trees flattened and instanced, the root's own meshes as they are.

    Raises
    ------
    ResourceError
        The extra with Embree's library is not installed.
    """

    def __init__(self, nodes: Nodes, lighting: Lighting) -> None:
        threads = os.cpu_count() or 1
        self._scene, self._lighting = EmbreeScene(threads), lighting
        children, placed = copies_of_trees(nodes)
        parts, starts, paints, at = {}, {}, [], 0
        for child in np.unique(children):
            corners, painted = nodes.flattened(int(child))
            starts[int(child)] = at
            at += len(painted)
            paints.append(painted)
            if nodes.names[child].endswith(OWN):
                self._scene.add_mesh(corners)
                continue
            parts[int(child)] = EmbreeScene(threads)
            parts[int(child)].add_mesh(corners)
            parts[int(child)].commit()
        before = sum(1 for child in np.unique(children) if nodes.names[child].endswith(OWN))
        copies = [n for n, child in enumerate(children) if int(child) in parts]
        matrices = placed[copies].reshape(-1, 3, 4)
        for n, matrix in zip(copies, matrices):
            self._scene.add_instance(parts[int(children[n])], matrix)
        self._scene.commit()
        firsts = np.array([starts[int(children[n])] for n in copies], np.int64)
        turns = np.linalg.inv(matrices[:, :, :3]).transpose(0, 2, 1).astype(np.float32)
        pad = np.zeros(before, np.int64)
        own = next((starts[int(child)] for child in np.unique(children) if nodes.names[child].endswith(OWN)), 0)
        self._tables = (
            np.concatenate([pad, firsts]),
            np.ascontiguousarray(np.concatenate([np.zeros((before, 3, 3), np.float32), turns])),
            own,
            np.concatenate(paints),
        )

    def render(self, camera: Camera, side: int) -> tuple[Array, float]:
        """Return light and coverage (H, W, 4), premultiplied, of side x side samples a pixel, and CPU seconds."""
        threads = numba.config.NUMBA_NUM_THREADS
        raw = np.zeros(threads * ROWS * 64 + 64, np.uint8)
        shift = -raw.ctypes.data % 64
        packets = raw[shift : shift + threads * ROWS * 64].view(np.float32).reshape(threads, ROWS * 16)
        arguments = np.zeros(16, np.int64)
        arguments.view(np.int32)[:2] = _COHERENT, -1
        directions = np.array([light.direction for light in self._lighting.lights], np.float32).reshape(-1, 3)
        colors = np.array([light.color for light in self._lighting.lights]).reshape(-1, 3)
        lighting = np.concatenate([self._lighting.ambient[None], colors]).astype(np.float32)
        out = np.empty((camera.height, camera.width, 4), np.float32)
        given = (
            self._scene.handle, arguments.ctypes.data, packets, packets.ctypes.data,
            camera.center.astype(np.float32), camera.world_from_pixel.astype(np.float32), side, self._tables,
            directions, lighting, out,
        )  # fmt: skip
        began = process_time()
        _caster()(*given)
        return out, process_time() - began
