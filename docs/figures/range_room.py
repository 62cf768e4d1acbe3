"""Real range data as one relief texture (oliveira2000, sec. 4.4): python docs/figures/range_room.py FOLDER.

FOLDER: a rectified pair of photos with dense disparities of the left one, in Middlebury's layout (images/left.png,
images/right.png, calib.txt, and the disparities as disp_left.npz). Prints how far the relief's pictures are from the
photos and depths; writes docs/images/range-room.png. Without the folder it says so and makes nothing.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

import numpy as np
from relief import GROUND, write

import ibrpipe
from ibrpipe.core.color import srgb_encode
from ibrpipe.io.photos.images import read_image
from ibrpipe.modelling.relief_textures import Plane, reliefs_from_range
from ibrpipe.types import Array, Camera, DepthImage


def read_pair(folder: Path) -> tuple[DepthImage, Camera, Array]:
    """The left photo with depths in metres, the right camera, and the right photo."""
    left, right = (read_image(folder / "images" / f"{side}.png")[..., :3] for side in ("left", "right"))
    disparity = np.load(folder / "disp_left.npz")["disp"].astype(np.float64)
    known = dict(re.findall(r"(\w+)=\[?([^\n\];]+)", (folder / "calib.txt").read_text()))
    focal, _, u = (float(each) for each in known["cam0"].split())
    v = float(re.search(r"cam0=\[[^;]+; 0 \S+ (\S+);", (folder / "calib.txt").read_text())[1])  # type: ignore[index]
    baseline, offset = 1e-3 * float(known["baseline"]), float(known["doffs"])
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = np.where(np.isfinite(disparity), focal * baseline / (disparity + offset), np.inf)
    rows, columns = disparity.shape
    calibration = np.array([[focal, 0, u + 0.5], [0, focal, v + 0.5], [0, 0, 1]])
    pose = np.eye(4)[:3]
    aside = calibration + np.array([[0, 0, offset], [0, 0, 0], [0, 0, 0]])
    shifted = pose - np.array([[0, 0, 0, baseline], [0, 0, 0, 0], [0, 0, 0, 0]])
    return (
        DepthImage(Camera(calibration, pose, columns, rows), left, depth),
        Camera(aside, shifted, columns, rows),
        right,
    )


def planes_over(image: DepthImage, columns: int) -> list[Plane]:
    """A plane across the view at the nearest depth, as wide as what is seen at the farthest, and one over the floor."""
    near, far = float(np.nanmin(image.depth)), float(np.nanmax(image.depth))
    camera = image.camera
    low, high = (far * camera.pixel_rays(np.array(each, float)) for each in ((0, 0), (camera.width, camera.height)))
    corner = np.array([low[0], low[1], near - 1e-3])
    across, down = np.array([high[0] - low[0], 0, 0]), np.array([0, high[1] - low[1], 0])
    front = Plane(corner, across, down, columns, round(columns * down[1] / across[0]), 0.0, far)
    middle = np.array([low[0], 0.0, far])  # looked at downward from the height of the eye
    below = Plane(middle, across, np.array([0, 0, near - far]), columns, round(columns * (far - near) / across[0]))
    return [front, below]


def psnr(one: Array, other: Array, where: Array) -> float:
    """Of 8-bit sRGB colours."""
    codes = [np.rint(255 * srgb_encode(np.clip(each, 0, 1)))[where] for each in (one, other)]
    return float(10 * np.log10(255**2 / np.mean((codes[0] - codes[1]) ** 2)))


def main() -> None:
    """Measure and draw."""
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path("FOLDER")
    if not (folder / "disp_left.npz").is_file():
        sys.exit(f"no picture of range data: {folder} with disp_left.npz missing")
    image, aside, photo = read_pair(folder)
    prepared = ibrpipe.prepare(list(reliefs_from_range([image], planes_over(image, 1400))), "prewarp")
    options = {"method": "pipelined", "level": 0, "max_step": 8.0}
    own = ibrpipe.render(prepared, image.camera, "prewarp", **options)
    both = np.isfinite(own.depth) & np.isfinite(image.depth)
    error = np.abs(own.depth - image.depth)[both] / image.depth[both]
    share = both.sum() / np.isfinite(image.depth).sum()
    sys.stdout.write(
        f"own view: {100 * share:.1f} % of the measured pixels, depth {100 * np.median(error):.3f} % off (median), "
        f"{100 * (error < 0.01).mean():.1f} % within 1 %, colour {psnr(own.color, image.color, both):.1f} dB\n"
    )
    moved = ibrpipe.render(prepared, aside, "prewarp", **options)
    there = moved.alpha > 0
    sys.stdout.write(
        f"right photo: {100 * there.mean():.1f} % covered, colour {psnr(moved.color, photo, there):.1f} dB; "
        f"left photo as it is {psnr(image.color, photo, there):.1f} dB\n"
    )
    size = (image.camera.width // 2, image.camera.height // 2)
    tilted = Camera.look_at((0.9, -0.5, 0.6), (0, 0, 3.2), (0, -1, 0), 33, *size)
    shots = []
    for camera in (aside.resized(*size), tilted):
        frame = ibrpipe.render(prepared, camera, "prewarp", samples=4, **options)
        shots.append(frame.color * frame.alpha[..., None] + GROUND * (1 - frame.alpha[..., None]))
    small = photo[: 2 * size[1], : 2 * size[0]].reshape(size[1], 2, size[0], 2, 3).mean(axis=(1, 3))
    write("range-room.png", [[small, *shots]])


if __name__ == "__main__":
    main()
