"""Photos of a drawn ChArUco board: python docs/figures/drawn_board.py CAPTURE; the cameras of a RUN: ... CAPTURE RUN.

The board of 5 x 7 squares of 40 mm lies on a rough poster. With RUN, the distances of its cameras from where they were
put are written, in millimetres and without any alignment.
"""

import sys
from pathlib import Path

import cv2
import numpy as np

from ibrpipe.io.cameras.colmap import read_model
from ibrpipe.types import Camera

#: Texels along the poster of 1 m, photos, rays per pixel along x and y, noise (8-bit steps)
TEXELS, PHOTOS, RAYS, NOISE = 4000, 12, 3, 2.0
WIDTH, HEIGHT, MIDDLE = 1200, 900, np.array([0.1, 0.14, 0.0])


def camera(index: int) -> Camera:
    """Camera 0.6 m from the board's middle; origin: the board's lower left corner, z towards the camera."""
    around = 2.0 * np.pi * index / PHOTOS
    rise = np.radians(50.0 + 15.0 * np.sin(3.0 * around))
    way = np.array([np.cos(around) * np.cos(rise), np.sin(around) * np.cos(rise), np.sin(rise)])
    aim = MIDDLE + 0.02 * np.array([np.cos(5.0 * around), np.sin(4.0 * around), 0.0])
    return Camera.look_at(tuple(MIDDLE + 0.6 * way), tuple(aim), (0, 0, 1), 50.0, WIDTH, HEIGHT)


def draw(folder: Path) -> None:
    """Write the photos."""
    random = np.random.default_rng(0)
    size = (TEXELS, TEXELS)
    parts = [random.standard_normal((cells, cells)).astype(np.float32) for cells in (12, 40, 120, 400, 1000)]
    poster = np.clip(120 + 25 * sum(cv2.resize(part, size, interpolation=cv2.INTER_CUBIC) for part in parts), 0, 255)
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    wide, high = round(0.20 * TEXELS), round(0.28 * TEXELS)
    left, top = (TEXELS - wide) // 2, (TEXELS - high) // 2
    poster[top - 40 : top + high + 40, left - 40 : left + wide + 40] = 255
    board = cv2.aruco.CharucoBoard((5, 7), 0.04, 0.03, dictionary)
    poster[top : top + high, left : left + wide] = board.generateImage((wide, high), marginSize=0)
    texel = 1.0 / TEXELS
    place = np.array([[texel, 0, (0.5 - left) * texel], [0, -texel, (top + high - 0.5) * texel], [0, 0, 1]])
    corner = np.array([[1, 0, -0.5], [0, 1, -0.5], [0, 0, 1]])
    folder.mkdir(parents=True, exist_ok=True)
    for index in range(PHOTOS):
        fine = camera(index).resized(WIDTH * RAYS, HEIGHT * RAYS)
        flat = corner @ fine.K @ fine.cam_from_world[:3][:, [0, 1, 3]] @ place
        seen = cv2.warpPerspective(poster.astype(np.float32), flat, (fine.width, fine.height), borderValue=60)
        photo = seen.reshape(HEIGHT, RAYS, WIDTH, RAYS).mean(axis=(1, 3))
        photo += NOISE * random.standard_normal(photo.shape)
        cv2.imwrite(str(folder / f"{index:02d}.png"), np.clip(np.rint(photo), 0, 255).astype(np.uint8))


if len(sys.argv) > 2:
    model = Path(sys.argv[2]) / "calibrate/sparse/0"
    off = []
    for shot in read_model(model, model):
        pose = shot.cam_from_world
        off.append(1e3 * np.linalg.norm(-pose[:, :3].T @ pose[:, 3] - camera(int(Path(shot.file).stem)).center))
    sys.stdout.write(f"{len(off)} cameras, mean {np.mean(off):.3f} mm, largest {np.max(off):.3f} mm\n")
else:
    draw(Path(sys.argv[1]) / "images")
