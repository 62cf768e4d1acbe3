"""Photos of a drawn wall from the cameras of a COLMAP model: python docs/figures/known_cameras.py MODEL CAPTURE.

The wall stands where the model's points are, rough to a twentieth of its half width. Its photos tell how much of an
error in calibration is the calibration's own, and how much the given cameras'.
"""

import sys
from pathlib import Path

import cv2
import numpy as np
import open3d as o3d

from ibrpipe.io.cameras.colmap import read_model

#: Texels across the wall, cells of the relief, standard deviation of the photos' noise (8-bit steps)
TEXELS, CELLS, NOISE = 4096, 512, 2.0


def noise(random: np.random.Generator, size: int, cells: tuple[int, ...]) -> np.ndarray:
    """Smooth noise of several scales, (size, size) float32, mean 0."""
    coarse = [random.standard_normal((count, count)).astype(np.float32) for count in cells]
    total: np.ndarray = sum(cv2.resize(each, (size, size), interpolation=cv2.INTER_CUBIC) for each in coarse)
    return total - total.mean()


model, capture = Path(sys.argv[1]), Path(sys.argv[2])
random = np.random.default_rng(0)
shots = read_model(model, model)
rows = [line.split()[1:4] for line in (model / "points3D.txt").read_text().splitlines() if line[:1] not in ("#", "")]
points = np.array(rows, float)
middle = np.median(points, axis=0)
right, up, out = np.linalg.svd(points - middle, full_matrices=False)[2]
half = 2.0 * np.percentile(np.abs((points - middle) @ right), 90)
texture = noise(random, TEXELS, (12, 40, 120, 400, 1300))
texture = np.clip(120 + 25 * texture, 0, 255)
steps = np.linspace(-half, half, CELLS)
u, v = np.meshgrid(steps, steps)
relief = 0.05 * half * noise(random, CELLS, (6, 20, 60))
vertices = middle + u[..., None] * right + v[..., None] * up + relief[..., None] * out
number = np.arange(CELLS * CELLS).reshape(CELLS, CELLS)
a, b, c, d = (part.ravel() for part in (number[:-1, :-1], number[:-1, 1:], number[1:, :-1], number[1:, 1:]))
faces = np.concatenate([np.stack([a, b, c], 1), np.stack([b, d, c], 1)])
scene = o3d.t.geometry.RaycastingScene()
scene.add_triangles(
    o3d.core.Tensor(vertices.reshape(-1, 3).astype(np.float32)), o3d.core.Tensor(faces.astype(np.uint32))
)
for shot in shots:
    turn = shot.cam_from_world[:, :3]
    eye = -turn.T @ shot.cam_from_world[:, 3]
    picture = np.zeros((shot.lens.height, shot.lens.width))
    for x, y in ((0.25, 0.25), (0.75, 0.25), (0.25, 0.75), (0.75, 0.75)):
        columns, lines = np.meshgrid(np.arange(shot.lens.width) + x, np.arange(shot.lens.height) + y)
        rays = np.stack([columns, lines, np.ones_like(columns)], -1) @ np.linalg.inv(shot.lens.K).T @ turn
        cast = np.concatenate([np.broadcast_to(eye, rays.shape), rays], -1).astype(np.float32)
        far = scene.cast_rays(o3d.core.Tensor(cast))["t_hit"].numpy().astype(float)
        place = eye + np.where(np.isfinite(far), far, 0.0)[..., None] * rays - middle
        where = [((place @ axis / half + 1) / 2 * TEXELS - 0.5).astype(np.float32) for axis in (right, up)]
        picture += np.where(np.isfinite(far), cv2.remap(texture, *where, cv2.INTER_LINEAR), 20.0) / 4
    picture += NOISE * random.standard_normal(picture.shape)
    file = capture / "images" / shot.file
    file.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(file), np.clip(np.rint(picture), 0, 255).astype(np.uint8), [cv2.IMWRITE_JPEG_QUALITY, 95])
