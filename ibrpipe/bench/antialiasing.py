"""What several rays a pixel bring and cost: error against a picture of 256 rays a pixel, and time, in one run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from statistics import median
from time import process_time

import numba
import numpy as np
from pydantic import Field

from ibrpipe.config import Document
from ibrpipe.core.color import srgb_encode
from ibrpipe.progress import track
from ibrpipe.renderers.api import Prepared, prepare, render
from ibrpipe.types import Array, Asset, Camera, Frame

#: rays of a pixel that are compared, the first being the measure of time, and those of the truth along either axis
COMPARED: tuple[int | str, ...] = (1, "adaptive", 4, 16)
TRUTH_SIDE = 16
#: rows of the truth that are drawn at once
BAND = 24
#: pictures are laid over this grey
BACKGROUND = 0.5


class AntialiasingRow(Document):
    """One number of rays a pixel, mean over the cameras."""

    samples: str = Field(description="Rays of a pixel")
    ms: float = Field(description="CPU time of a frame over the number of threads, milliseconds")
    ratio: float = Field(description="Median over the turns of its time against that of one ray a pixel")
    psnr: float = Field(description="Against 256 rays a pixel, over grey, 8-bit sRGB, dB")
    rays: float = Field(description="Rays a pixel, on the average")


class Antialiasing(Document):
    """Error and time of several rays a pixel."""

    width: int = Field(description="Pixels of a frame")
    height: int = Field(description="Pixels of a frame")
    cameras: int = Field(description="Cameras")
    threads: int = Field(description="Threads of every frame")
    rows: list[AntialiasingRow] = Field(description="Numbers of rays a pixel, one ray first")


@dataclass(frozen=True)
class _Turn:
    """Milliseconds, PSNR and rays a pixel of every number of rays, of one camera."""

    ms: dict[str, list[float]]
    psnr: dict[str, float]
    rays: dict[str, float]


def run_antialiasing(asset: Asset, cameras: Sequence[Camera], repeats: int, renderer: str = "ldi") -> Antialiasing:
    """Draw every camera with all numbers of rays in turn, and compare each with 256 rays a pixel."""
    prepared = prepare(asset, renderer)
    turns = [_turn(prepared, camera, repeats) for camera in track(cameras, "antialiasing")]
    rows = []
    for samples in map(str, COMPARED):
        ratios = [ms / one for turn in turns for ms, one in zip(turn.ms[samples], turn.ms["1"], strict=True)]
        rows.append(
            AntialiasingRow(
                samples=samples,
                ms=float(np.mean([min(turn.ms[samples]) for turn in turns])),
                ratio=median(ratios),
                psnr=float(np.mean([turn.psnr[samples] for turn in turns])),
                rays=float(np.mean([turn.rays[samples] for turn in turns])),
            )
        )
    first = cameras[0]
    return Antialiasing(
        width=first.width, height=first.height, cameras=len(cameras), threads=numba.get_num_threads(), rows=rows
    )


def _turn(prepared: Prepared, camera: Camera, repeats: int) -> _Turn:
    truth = _codes(*draw_truth(prepared, camera))
    turn = _Turn({str(n): [] for n in COMPARED}, {}, {})
    for _ in range(repeats + 1):
        for samples in COMPARED:
            began = process_time()
            frame = render(prepared, camera, prepared.renderer, samples=samples)
            turn.ms[str(samples)].append(1e3 * (process_time() - began) / numba.get_num_threads())
            turn.psnr[str(samples)] = _psnr(frame, truth)
            edges = 8 * frame.stats.get("edge_pixels", 0) / (camera.width * camera.height)
            turn.rays[str(samples)] = samples if isinstance(samples, int) else 1 + edges
    for taken in turn.ms.values():
        del taken[0]  # compiles, and warms
    return turn


def draw_truth(prepared: Prepared, camera: Camera) -> tuple[Array, Array]:
    """Return colour (H, W, 3), multiplied by alpha, and alpha (H, W) of TRUTH_SIDE^2 rays a pixel, band by band."""
    color, alpha = np.zeros((camera.height, camera.width, 3)), np.zeros((camera.height, camera.width))
    for top in range(0, camera.height, BAND):
        own = slice(top, min(top + BAND, camera.height))
        K = camera.K.copy()
        K[1, 2] -= top
        band = replace(camera, K=K, height=own.stop - top)
        large = band.resized(band.width * TRUTH_SIDE, band.height * TRUTH_SIDE)
        frame = render(prepared, large, prepared.renderer, ("color", "alpha"))
        assert frame.color is not None
        assert frame.alpha is not None
        shape = (band.height, TRUTH_SIDE, band.width, TRUTH_SIDE)
        alpha[own] = frame.alpha.reshape(shape).mean(axis=(1, 3))
        color[own] = (frame.color * frame.alpha[..., None]).reshape(*shape, 3).mean(axis=(1, 3))
    return color, alpha


def _psnr(frame: Frame, truth: Array) -> float:
    assert frame.color is not None
    assert frame.alpha is not None
    codes = _codes(frame.color * frame.alpha[..., None], frame.alpha)
    return float(-10 * np.log10(max(float(np.mean((codes - truth) ** 2)), 1e-10)))


def _codes(premultiplied: Array, alpha: Array) -> Array:
    """8-bit sRGB codes, 0 to 1, of a picture over grey."""
    linear = np.minimum(premultiplied + BACKGROUND * (1 - alpha[..., None]), 1.0)
    return np.round(255 * srgb_encode(linear)) / 255
