"""Picture of the page on epipolar warping: python docs/figures/hard_cases.py; written to docs/images.

Exact depth, shown depth, wrong pixels in red.
"""

from pathlib import Path

import cv2
import numpy as np

from ibrpipe.bench.cases import choose_cases
from ibrpipe.bench.hard_cases.run import run_hard_cases
from ibrpipe.bench.report.hard_page import draw_wrong
from ibrpipe.bench.settings import choose_settings

IMAGES = Path(__file__).resolve().parent.parent / "images"
SHOWN = [
    ("epipolar nearest", "surface-steep-step"),
    ("epipolar nearest", "surface-one-texel-islands"),
]
rows = []
for label, name in SHOWN:
    run = run_hard_cases(choose_cases([name]), choose_settings([label]), ("float64",), (32,))
    parts = draw_wrong(run.pictures[name, label]).values()
    rows.append(
        np.hstack(
            [np.pad(part.repeat(5, 0).repeat(5, 1), ((4, 4), (4, 4), (0, 0)), constant_values=255) for part in parts]
        )
    )
cv2.imwrite(str(IMAGES / "epipolar-hard-cases.png"), np.vstack(rows)[:, :, ::-1])
