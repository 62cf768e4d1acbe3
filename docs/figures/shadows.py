"""Picture and figures of shadows in docs/renderers/hierarchical.md: a small forest against ray casting.

python docs/figures/shadows.py docs/images
"""

import sys
from pathlib import Path

import numpy as np

import ibrpipe
from ibrpipe.bench.forest.pictures import our_picture, over_sky
from ibrpipe.bench.forest.run import psnr
from ibrpipe.bench.oracles.shadows import LitScene
from ibrpipe.core.directions import spread_directions
from ibrpipe.io.photos.images import write_png
from ibrpipe.synthetic.instanced.forest import forest, forest_cameras

TREES, SIZE, DIRECTIONS = 24, (200, 150), 16


def main(folder):
    """Write hierarchical-shadows.png, and a row of the table for each view."""
    scene = forest(TREES)
    prepared, exact, rows = ibrpipe.prepare(scene, "hierarchical"), LitScene(scene), []
    for view, camera in forest_cameras(TREES, *SIZE).items():
        plain, dark, sky = (
            over_sky(*our_picture(prepared, camera, "slices", **options))
            for options in ({}, {"shadows": True}, {"shadows": True, "occlusion": DIRECTIONS})
        )
        lit, shaded = (over_sky(*exact.picture(camera, 6, shadows)).astype(np.float32) for shadows in (False, True))
        hidden = over_sky(*exact.picture(camera, 3, sky=spread_directions(DIRECTIONS))).astype(np.float32)
        pairs = ((plain, lit), (dark, shaded), (plain, shaded), (sky, hidden), (dark, hidden))
        sys.stdout.write(f"| {view} | " + " | ".join(f"{psnr(*pair):.1f}" for pair in pairs) + " |\n")
        rows.append(np.concatenate([plain, dark, sky, shaded, hidden], axis=1))
    write_png(Path(folder) / "hierarchical-shadows.png", np.concatenate(rows))


if __name__ == "__main__":
    main(sys.argv[1])
