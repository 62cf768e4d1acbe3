"""What `prewarp` makes on its way: python docs/figures/prewarp_stages.py [MESH]; written to docs/images.

Stages of the warp (oliveira2000, fig. 9) need nothing; the quadrilaterals of an object (fig. 17), levels of its pyramid
(fig. 20) and skins across its jumps of depth need a mesh, and are left out, which is told, where it is missing.
"""

from __future__ import annotations

import sys
from pathlib import Path

import cv2
import numpy as np
from relief import GROUND, IMAGES, brick_wall, picture, write

import ibrpipe
from ibrpipe.io.surfaces.colored_meshes import read_colored
from ibrpipe.modelling.relief_textures import SIDES, asset_from_reliefs, box_from_mesh
from ibrpipe.types import Array, Asset, Camera

SIZE = (250, 190)


def card(color: Array, alpha: Array | None = None) -> Array:
    """A picture fitted into one of `SIZE`, on light ground."""
    alpha = np.ones(color.shape[:2]) if alpha is None else alpha
    shown = color * alpha[..., None] + GROUND * (1 - alpha[..., None])
    scale = min(SIZE[0] / shown.shape[1], SIZE[1] / shown.shape[0]) * 0.96
    size = max(round(scale * shown.shape[1]), 1), max(round(scale * shown.shape[0]), 1)
    small = cv2.resize(shown.astype(np.float32), size, interpolation=cv2.INTER_AREA)
    out = np.full((SIZE[1], SIZE[0], 3), GROUND, np.float32)
    left, top = (SIZE[0] - size[0]) // 2, (SIZE[1] - size[1]) // 2
    out[top : top + size[1], left : left + size[0]] = small
    return out


def stages() -> None:
    """The bricks as they are, after the rows, after both passes, and mapped onto their rectangle."""
    wall = brick_wall()
    rows = []
    for eye in ((1.5, 0.9, 1.3), (-1.9, -0.7, 0.9)):
        view = Camera.look_at(eye, (0, 0, 0), (0, 1, 0), 50.0, *SIZE)
        whole = Camera.look_at(eye, (0, 0, 0), (0, 1, 0), 120.0, *SIZE)  # so that nothing of the rectangle is left out
        warped = [ibrpipe.prewarp(wall, whole, stage, level=0)[0] for stage in ("rows", "both")]
        rows.append(
            [card(wall.color), *(card(each.color, each.alpha) for each in warped), picture(wall, view, level=0)]
        )
    write("prewarp-stages.png", rows)


def quadrilaterals(asset: Asset, view: Camera) -> None:
    """The three warped quadrilaterals of an object, and the view of them."""
    textures = ibrpipe.prewarp(asset, view, level=0)
    write("prewarp-quads.png", [[*(card(each.color, each.alpha) for each in textures), picture(asset, view, level=0)]])


def levels(asset: Asset, view: Camera) -> None:
    """Levels 0 to 3 of the pyramid."""
    write("prewarp-levels.png", [[picture(asset, view, level=level) for level in range(4)]])


def skins(asset: Asset, view: Camera) -> None:
    """Jumps of depth with skins, and parted above four texels."""
    shots = [picture(asset, view, level=0, max_step=step, quads="each") for step in (np.inf, 4.0)]
    write("prewarp-skins.png", [shots])


def main() -> None:
    """Make all pictures."""
    IMAGES.mkdir(exist_ok=True)
    stages()
    if len(sys.argv) < 2 or not Path(sys.argv[1]).is_file():
        sys.exit(f"only the stages: {sys.argv[1] if len(sys.argv) > 1 else 'MESH'} missing")
    mesh, colors = read_colored(Path(sys.argv[1]))
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    middle, size = 0.5 * (low + high), float(np.linalg.norm(high - low))
    asset = asset_from_reliefs(box_from_mesh(mesh, 384, colors), list(SIDES), sys.argv[1])
    way = np.array([0.8, 0.5, 1.0])
    view = Camera.look_at(middle + 1.25 * size * way / np.linalg.norm(way), middle, (0, 1, 0), 44.0, *SIZE)
    quadrilaterals(asset, view)
    levels(asset, view)
    skins(asset_from_reliefs(box_from_mesh(mesh, 384, colors)[4:5], ["+z"], sys.argv[1]), view)


if __name__ == "__main__":
    main()
