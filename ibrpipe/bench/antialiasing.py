"""What several rays a pixel bring and cost: error against a picture of 256 rays a pixel, and time, in one run."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from statistics import fmean
from time import process_time

import numba
import numpy as np
from pydantic import Field

from ibrpipe.config import Document
from ibrpipe.core.color import srgb_encode
from ibrpipe.evaluation.timing import interleave
from ibrpipe.progress import track
from ibrpipe.renderers.antialiasing import supersample
from ibrpipe.renderers.api import Prepared, prepare, render
from ibrpipe.types import Array, Asset, Camera, Frame

#: rays of a pixel that are compared, the first being the measure of time, and those of the truth
COMPARED: tuple[int | str, ...] = (1, "adaptive", 4, 16)
TRUTH = 256
#: pictures are laid over this grey
BACKGROUND = 0.5


class AntialiasingRow(Document):
    """One number of rays a pixel, mean over the cameras."""

    samples: str = Field(description="Rays of a pixel")
    ms: float = Field(description="Least CPU time of a frame over the number of threads, milliseconds")
    ratio: float = Field(description="Median time of a frame against that of one ray a pixel")
    psnr: float = Field(description="Against 256 rays a pixel, over grey, 8-bit sRGB, dB")
    rays: float = Field(description="Rays cast a pixel, on the average")


class Antialiasing(Document):
    """Error and time of several rays a pixel."""

    width: int = Field(description="Pixels of a frame")
    height: int = Field(description="Pixels of a frame")
    cameras: int = Field(description="Cameras")
    threads: int = Field(description="Threads of every frame")
    rows: list[AntialiasingRow] = Field(description="Numbers of rays a pixel, one ray first")


def run_antialiasing(asset: Asset, cameras: Sequence[Camera], repeats: int, renderer: str = "ldi") -> Antialiasing:
    """Draw every camera with all numbers of rays in turn, and compare each with 256 rays a pixel."""
    prepared = prepare(asset, renderer)
    found = [_measured(prepared, camera, repeats) for camera in track(cameras, "antialiasing")]
    first = cameras[0]
    return Antialiasing(
        width=first.width,
        height=first.height,
        cameras=len(cameras),
        threads=numba.get_num_threads(),
        rows=[_mean(rows) for rows in zip(*found, strict=True)],
    )


def _measured(prepared: Prepared, camera: Camera, repeats: int) -> list[AntialiasingRow]:
    """Return the figures of every number of rays, of one camera."""
    draws = {str(each): partial(render, prepared, camera, prepared.renderer, samples=each) for each in COMPARED}
    truth, pixels = _codes(*draw_truth(prepared, camera)), camera.width * camera.height
    frames = {samples: draw() for samples, draw in draws.items()}  # compiles, and warms
    times = interleave(draws, repeats, warm=False, clock=process_time)
    return [
        AntialiasingRow(
            samples=samples,
            ms=times[samples].fastest / numba.get_num_threads(),
            ratio=times[samples].median / times["1"].median,
            psnr=_psnr(frame, truth),
            rays=frame.stats.get("rays", pixels) / pixels,
        )
        for samples, frame in frames.items()
    ]


def _mean(rows: Sequence[AntialiasingRow]) -> AntialiasingRow:
    names = ("ms", "ratio", "psnr", "rays")
    return rows[0].model_copy(update={name: fmean(getattr(row, name) for row in rows) for name in names})


def draw_truth(prepared: Prepared, camera: Camera) -> tuple[Array, Array]:
    """Return colour (H, W, 3), multiplied by alpha, and alpha (H, W) of `TRUTH` rays a pixel, float32."""
    frame = supersample(
        lambda view, wanted: render(prepared, view, prepared.renderer, wanted), camera, ("color", "alpha"), TRUTH
    )
    assert frame.color is not None
    assert frame.alpha is not None
    return frame.color * frame.alpha[..., None], frame.alpha


def _psnr(frame: Frame, truth: Array) -> float:
    assert frame.color is not None
    assert frame.alpha is not None
    codes = _codes(frame.color * frame.alpha[..., None], frame.alpha)
    return float(-10 * np.log10(max(float(np.mean((codes - truth) ** 2)), 1e-10)))


def _codes(premultiplied: Array, alpha: Array) -> Array:
    """8-bit sRGB codes, 0 to 1, of a picture over grey."""
    linear = np.minimum(premultiplied + BACKGROUND * (1 - alpha[..., None]), 1.0)
    return np.round(255 * srgb_encode(linear)) / 255
