"""Pictures of a textured mesh as relief textures, depth images and a dual relief; written to docs/images.

python docs/figures/colored.py MESH.obj [TEXTURE.png]; without the files it says so and makes nothing.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from relief import IMAGES, picture, write

import ibrpipe
from ibrpipe.io.surfaces.colored_meshes import read_colored
from ibrpipe.modelling.depth_images import depth_images_asset
from ibrpipe.modelling.dual_relief import dual_relief_from_mesh
from ibrpipe.modelling.frusta import greedy_frusta
from ibrpipe.modelling.relief_textures import SIDES, asset_from_reliefs, box_from_mesh
from ibrpipe.types import Camera

#: from where the object is seen: from the middle, in its own axes
WAYS = ((0.75, 0.35, -1.0), (0.2, 0.9, -1.0), (-1.0, 0.25, 0.35))


def main() -> None:
    """Make the picture: a row for each way to keep the object, seen from three sides."""
    files = [Path(word) for word in sys.argv[1:3]]
    missing = [str(file) for file in files if not file.is_file()]
    if not files or missing:
        sys.exit(f"no picture of a textured mesh: {', '.join(missing) or 'MESH and TEXTURE'} missing")
    IMAGES.mkdir(exist_ok=True)
    mesh, colors = read_colored(files[0], files[1] if len(files) > 1 else None)
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    middle, size = 0.5 * (low + high), float(np.linalg.norm(high - low))
    cameras = [
        Camera.look_at(middle + 1.05 * size * np.array(way) / np.linalg.norm(way), middle, (0, 1, 0), 38, 220, 200)
        for way in WAYS
    ]
    box = ibrpipe.prepare(asset_from_reliefs(box_from_mesh(mesh, 384, colors), list(SIDES), files[0].name), "prewarp")
    frusta, _ = greedy_frusta(mesh, 12)
    maps = ibrpipe.prepare(depth_images_asset(mesh, frusta, 384, files[0].name, colors), "epipolar")
    dual = ibrpipe.prepare(dual_relief_from_mesh(mesh, "+x", 384, colors), "relief")
    rows = [
        [picture(box, camera, level=0, method="pipelined") for camera in cameras],
        [picture(maps, camera, "epipolar") for camera in cameras],
        [picture(dual, camera, "relief", model="shell") for camera in cameras],
    ]
    write("colored-object.png", rows)


if __name__ == "__main__":
    main()
