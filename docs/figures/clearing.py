"""Draw docs/images/clearing.png: a captured asset on a lawn in a forest, all in one scene.

ibrpipe synth forest SCENE --trees 400 --asset demo/asset
python docs/figures/clearing.py SCENE docs/images/clearing.png
"""

import sys
from pathlib import Path

import numpy as np

import ibrpipe
from ibrpipe.io.photos.images import write_png

SKY = np.array([0.55, 0.70, 0.90], np.float32)


def main() -> None:
    """Render three views side by side."""
    scene, target = ibrpipe.read_scene(sys.argv[1]), Path(sys.argv[2])
    prepared = ibrpipe.prepare(scene, "hierarchical")
    pictures = []
    for eye, at in (((7.0, -8.0, 2.6), (0, 0, 2.2)), ((13.5, 6.5, 2.2), (0, 0, 2.0)), ((0, -75, 48), (0, 0, 0))):
        camera = ibrpipe.Camera.look_at(eye, at, fov_y_deg=48.0, width=420, height=420)
        frame = ibrpipe.render(prepared, camera, "hierarchical", shadows=True, shadow_size=4096)
        sys.stdout.write(f"{frame.stats}\n")
        pictures.append(frame.color * frame.alpha[..., None] + (1 - frame.alpha[..., None]) * SKY)
    write_png(target, np.concatenate(pictures, axis=1))


if __name__ == "__main__":
    main()
