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
from ibrpipe.types import Array, Camera, Lighting

_COHERENT = 1 << 16


@cache
def _caster() -> Any:
    return packet_caster()


class Peer:
    """A scene as Embree takes it: the root's children flattened and instanced, the root's own meshes as they are.

    Raises
    ------
    ResourceError
        The extra with Embree's library is not installed.
    """

    def __init__(self, nodes: Nodes, lighting: Lighting) -> None:
        threads = os.cpu_count() or 1
        self._scene, self._lighting = EmbreeScene(threads), lighting
        first, last = int(nodes.copies[nodes.root]), int(nodes.copies[nodes.root + 1])
        children = nodes.children[first:last]
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
        copies = [n for n in range(first, last) if int(nodes.children[n]) in parts]
        matrices = nodes.matrices[copies].reshape(-1, 3, 4)
        for n, matrix in zip(copies, matrices):
            self._scene.add_instance(parts[int(nodes.children[n])], matrix)
        self._scene.commit()
        firsts = np.array([starts[int(nodes.children[n])] for n in copies], np.int64)
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
