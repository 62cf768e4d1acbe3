"""How the figures of an evaluation are taken, in numbers and in words."""

from __future__ import annotations

import numba

from ibrpipe.core.psnr import PSNR_CAP
from ibrpipe.evaluation.image_scores import FLIP_PPD, MASK_THRESHOLD, SSIM_WINDOW
from ibrpipe.evaluation.metrics import Protocol
from ibrpipe.types import Camera

_BALANCED = (
    "Photos were brought to one exposure and white balance: {why}. Held-out photos, too, to the colours of the others: "
    "these three factors a photo are all that was taken from them."
)


def make_protocol(
    timed: Camera, repeats: int, views: int, highlight_threshold: int, samples: int | str, photometry: str | None = None
) -> Protocol:
    """Return the protocol of frames of `timed`'s size, timed `repeats` times in `views` views.

    Parameters
    ----------
    photometry : str or None
        Why the photos were brought to one exposure; None = they were not.
    """
    threads = numba.get_num_threads()
    return Protocol(
        mask_threshold=MASK_THRESHOLD,
        highlight_threshold=highlight_threshold,
        ssim_window=SSIM_WINDOW,
        flip_ppd=FLIP_PPD,
        psnr_cap=PSNR_CAP,
        timing_width=timed.width,
        timing_height=timed.height,
        timing_repeats=repeats,
        timing_views=views,
        threads=threads,
        lines=[
            "Held-out photos are used for measuring only. All scores compare 8-bit sRGB pictures, and only pixels "
            f"whose mask coverage is at least {MASK_THRESHOLD}; figures are means over the views.",
            *([] if photometry is None else [_BALANCED.format(why=photometry)]),
            "Mask pixels that a render leaves uncovered are black and count as such. Outside the mask both pictures "
            "are black, so that nothing there reaches into a window or filter.",
            "All scores are taken a second time over the mask pixels that every renderer and baseline covers. Where "
            "the photos have no masks, these come first: sky and walls that no method knows would drown all else.",
            "PSNR: mean squared error over the mask's pixels and three channels, peak 255; "
            f"{PSNR_CAP:.0f} dB stands for equal pictures.",
            f"SSIM: scikit-image, window {SSIM_WINDOW}, each channel for itself, mean of the map over the mask.",
            f"FLIP: flip-evaluator, LDR, {FLIP_PPD:.0f} pixels per degree, mean of the map over the mask.",
            "Depth error: along camera z, in scene units, over mask pixels that both truth and render hit.",
            "Coverage: share of the mask's pixels that the render hits.",
            "Highlight pixels: pixels that all methods cover, where the photo and the diffuse-only picture differ by "
            f"{highlight_threshold} of 255 codes or more in some channel, in patches of at least 3 x 3. They are "
            "chosen by the error of diffuse-only, bound to do badly there; read them beside those of all pixels.",
            "Pixels of all pictures, renders and baselines alike, are drawn from "
            + (
                f"{samples} ray{'s' * (samples != 1)}."
                if isinstance(samples, int)
                else "one ray, and from nine where a pixel shows an edge of the method's own surface."
            ),
            "diffuse: the same asset and renderer without residuals. ulr: unstructured lumigraph; at every pixel the "
            "mesh is cast and the best four training photos that see the point are blended, weights dot_i - dot_4. "
            "mesh: the mesh with, at every pixel, the median of all training photos that see the point; its time is "
            "that of Embree's ray cast alone (Open3D's RaycastingScene, rays laid out beforehand), one a pixel, no "
            "colouring.",
            f"Times: frames {timed.width} pixels wide, colour and depth, {threads} threads each, {views} views; all "
            f"methods take turns, each draws twice in its turn and the second counts; median of {repeats} turns, "
            "fewer for methods that need more than their share of the time. "
            "Reading, preparing and writing are outside the timer.",
        ],
    )
