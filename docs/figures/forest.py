"""Pictures of docs/renderers/hierarchical.md: a forest from slices, beside the published method and its own polygons.

python docs/figures/forest.py docs/images
"""

import sys
from pathlib import Path

import numpy as np

import ibrpipe
from ibrpipe.bench.forest.pictures import our_picture, over_sky
from ibrpipe.core.color import srgb_decode, srgb_encode
from ibrpipe.io.photos.images import write_png
from ibrpipe.synthetic.instanced.forest import forest, forest_cameras

TREES, SIZE, GAIN = 100, (280, 210), 4.0


def main(folder):
    """Write hierarchical-forest.png: slices, the published method, polygons, and four times the error of slices."""
    prepared = ibrpipe.prepare(forest(TREES), "hierarchical")
    rows = []
    for camera in forest_cameras(TREES, *SIZE).values():
        ours, paper, exact = (
            over_sky(*our_picture(prepared, camera, mode)) for mode in ("slices", "reproject", "polygons")
        )
        error = srgb_decode(np.clip(GAIN * np.abs(srgb_encode(ours) - srgb_encode(exact)), 0, 1))
        rows.append(np.concatenate([ours, paper, exact, error], axis=1))
    write_png(Path(folder) / "hierarchical-forest.png", np.concatenate(rows))


if __name__ == "__main__":
    main(sys.argv[1])
