"""Nearest hits by projecting the patches of layered images; see :mod:`ibrpipe.core.ldi.project`."""

from __future__ import annotations

import numba
import numpy as np

from ibrpipe.core.ldi.project import merge_pictures, project_patches
from ibrpipe.renderers.background_compile import BackgroundCompile, Kernel
from ibrpipe.renderers.scene import Scene
from ibrpipe.renderers.search.epipolar_lines import EYE
from ibrpipe.types import Array, Camera

#: what a second process compiles at the first call
BACKGROUND = BackgroundCompile(
    (
        Kernel(
            "ldi.project", "project_patches",
            "(Tuple((float32[:,:,::1], float32[:,:,::1], uint8[:,::1], uint32[:,::1])), int64[:,::1], float64[:,::1], "
            "Tuple((float64[:,:,::1], float64[:,::1], float64[::1], float64[::1], boolean[::1])), "
            "Tuple((int64, int64)), int64[:,:,::1], int64[::1])",
        ),
    )
)  # fmt: skip


def project(scene: Scene, camera: Camera) -> tuple[Array, Array]:
    """Return depth and number (H, W) of the nearest hit of every pixel with the patches of layered images."""
    depth, ids = project_behind(scene, camera, np.full(camera.width * camera.height, -1, np.int64), 1)
    return depth[0], ids[0]


def project_behind(scene: Scene, camera: Camera, floors: Array, ranks: int) -> tuple[Array, Array]:
    """Return depths (ranks, H, W) and numbers of so many hits of every pixel, one behind another, beyond its floor.

    Parameters
    ----------
    floors : (H * W,) int64
        Float32 bits of a camera depth, times 2**32, plus the number of a hit there; -1 = the eye.
    """
    parts, (columns, rows) = numba.get_num_threads(), (camera.width, camera.height)
    memory = scene.pictures.pop() if scene.pictures else np.empty(0, np.int64)
    if len(memory) < parts * ranks * columns * rows:
        memory = np.empty(parts * ranks * columns * rows, np.int64)
    keys = memory[: parts * ranks * columns * rows].reshape(parts, ranks, columns * rows)
    views, blocks = patch_views(scene, camera), scene.blocks
    BACKGROUND.wait()
    project_patches(blocks.patches, blocks.blocks, blocks.bounds, views, (columns, rows), keys, floors)
    depth, ids = np.empty((ranks, rows, columns), np.float32), np.empty((ranks, rows, columns), np.uint32)
    merge_pictures(keys, columns, depth, ids)
    scene.pictures.append(memory)
    return depth, ids


def patch_views(scene: Scene, camera: Camera) -> tuple[Array, Array, Array, Array, Array]:
    """Return what :mod:`ibrpipe.core.ldi.project` calls views: pixels, rays, eyes, signs, perspective."""
    poses = [field.pose for _, field in scene.patches]
    starts, directions = (
        np.stack(part) for part in zip(*(pose.field_from_pixel(camera) for pose in poses), strict=True)
    )
    pixels = np.stack([pose.pixel_from_field(camera) for pose in poses])
    eyes = np.array([EYE * field.reach for _, field in scene.patches])
    signs = np.sign(np.linalg.det(pixels[:, :, :3])) * np.sign(starts[:, 3])  # the line to an eye behind a frame's
    perspective = np.array([pose.perspective for pose in poses])
    return pixels, pack_rays(starts, directions), eyes, signs, perspective


def pack_rays(start: Array, directions: Array) -> Array:
    """(..., 16) float64: start (..., 4), then directions (..., 4, 3) row by row, for the projecting kernels."""
    return np.concatenate([start, directions.reshape(*directions.shape[:-2], 12)], axis=-1)
