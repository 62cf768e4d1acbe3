"""Peak signal-to-noise ratio of 8-bit pictures."""

import numpy as np

#: dB that stand for equal pictures
PSNR_CAP = 100.0


def psnr(truth, picture, mask):
    """Return the peak signal-to-noise ratio over the mask in dB, peak 255; None for an empty mask.

    The mean squared error runs over all mask pixels and the three channels. Equal pictures get `PSNR_CAP`.
    """
    difference = truth[mask].astype(np.float64) - picture[mask]
    if difference.size == 0:
        return None
    error = float(np.mean(difference**2))
    return PSNR_CAP if error == 0.0 else min(PSNR_CAP, float(10.0 * np.log10(255.0**2 / error)))
