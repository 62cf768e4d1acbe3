"""What an exported surface loses: frames of the written file against the asset's own and against photos."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass

import numpy as np

from ibrpipe.core.color import srgb_encode, to_bytes
from ibrpipe.core.psnr import psnr
from ibrpipe.io.views import View, load_view, spread
from ibrpipe.progress import track
from ibrpipe.renderers.api import prepare, render
from ibrpipe.types import Array, Asset, Camera, Frame

#: views that are drawn, their widest picture in pixels, rays a pixel
VIEWS, WIDEST, RAYS = 8, 640, 4
#: least share of a pixel that counts as covered
COVERED = 0.5


@dataclass(frozen=True)
class Fidelity:
    """Means over the views, dB of 8-bit sRGB pictures; None = unknown.

    Attributes
    ----------
    views : int
    held_out : bool
        The views are photos that the asset was not made from.
    asset_db : float
        The file's frames against the asset's, where the asset covers the pixel.
    coverage : float
        Share of pixels in which one of both covers and the other does not, of those that the asset covers.
    photos_db : float or None
        The file's frames against the photos, within their masks.
    asset_photos_db : float or None
        The asset's frames against the photos.
    """

    views: int
    held_out: bool
    asset_db: float
    coverage: float
    photos_db: float | None
    asset_photos_db: float | None

    def record(self) -> dict[str, float | int | bool | None]:
        """Return the figures as JSON, rounded."""
        return {name: round(value, 4) if isinstance(value, float) else value for name, value in asdict(self).items()}

    def told(self) -> str:
        """Return the figures as a clause."""
        own = f"{self.asset_db:.1f} dB against the asset's own frames ({self.views} views)"
        if self.photos_db is None or self.asset_photos_db is None:
            return own
        kind = "held-out photos" if self.held_out else "the photos"
        lost = self.asset_photos_db - self.photos_db
        return f"{self.photos_db:.1f} dB against {kind}, the asset {self.asset_photos_db:.1f}: {lost:.1f} lost; {own}"


def measure(
    draw: Callable[[Camera], Frame],
    asset: Asset,
    views: Sequence[View],
    held_out: bool,
    around: Sequence[Camera],
    diffuse: bool = False,
) -> Fidelity:
    """Compare frames.

    Parameters
    ----------
    draw : callable
        What the written file shows to a camera: colour and alpha.
    views : sequence of View
        Photos; without any, the cameras `around` are drawn.
    diffuse : bool
        Without view dependence.
    """
    chosen: list[View | None] = list(spread(list(views), VIEWS)) or [None] * len(around)
    prepared = prepare(asset)
    against, other, photos, own = [], [], [], []
    for index, view in enumerate(track(chosen, "measure")):
        camera = _small(around[index] if view is None else view.camera)
        first = draw(camera)
        second = render(prepared, camera, outputs=("color", "alpha"), samples=RAYS, residuals=not diffuse)
        pair = [_codes(frame) for frame in (first, second)]
        covered = [_array(frame.alpha) >= COVERED for frame in (first, second)]
        against.append(psnr(pair[1], pair[0], covered[1]))
        other.append(float((covered[0] != covered[1]).sum() / max(1, covered[1].sum())))
        if view is not None:
            truth, mask = _photo(view, camera)
            photos.append(psnr(truth, pair[0], mask))
            own.append(psnr(truth, pair[1], mask))
    return Fidelity(len(chosen), held_out, _mean(against) or 0.0, float(np.mean(other)), _mean(photos), _mean(own))


def _small(camera: Camera) -> Camera:
    if camera.width <= WIDEST:
        return camera
    return camera.resized(WIDEST, max(1, round(camera.height * WIDEST / camera.width)))


def _photo(view: View, camera: Camera) -> tuple[Array, Array]:
    """What a photo shows at a camera's size: (H, W, 3) uint8 sRGB and (H, W) bool."""
    import cv2

    color, mask = load_view(view)
    if color.shape[:2] != (camera.height, camera.width):
        size = (camera.width, camera.height)
        color, mask = (cv2.resize(each, size, interpolation=cv2.INTER_AREA) for each in (color, mask))
    return to_bytes(srgb_encode(color)), mask >= COVERED


def _codes(frame: Frame) -> Array:
    return to_bytes(srgb_encode(_array(frame.color)))


def _mean(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return float(np.mean(known)) if known else None


def _array(part: Array | None) -> Array:
    assert part is not None
    return part
