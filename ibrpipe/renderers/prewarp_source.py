"""What the pre-warp needs of a source: the first layer of a parallel frame as heights, colours, and joints."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ibrpipe.core import prewarp
from ibrpipe.errors import RendererError
from ibrpipe.renderers.prewarp_faces import Face, Sight
from ibrpipe.types import Array, LayeredDepthImage, ParallelFrame, ReliefTexture, SpiralTexture

#: steps between neighbouring samples of a layered image, in texels, above which they are not joined
GAP = 4.0
#: jump of depth in a pre-warped picture, in texels, across which nothing is interpolated in the view
JUMP = 4.0


@dataclass(frozen=True, eq=False)
class Relief:
    """A relief texture ready to be warped.

    Attributes
    ----------
    frame : ParallelFrame
    height : (H, W) float32, along ``frame.f``; NaN = transparent
    color : (H, W, 3) float32, linear
    gap : float
        Greatest step of height between neighbours that are joined; inf = all are.
    front_only : bool
        Only the side of lesser depth is seen.
    """

    frame: ParallelFrame
    height: Array
    color: Array
    gap: float
    front_only: bool

    @property
    def bytes(self) -> int:
        """Bytes held beyond the source."""
        return 0

    @property
    def broken(self) -> bool:
        """Whether steps between neighbours are looked at."""
        return bool(np.isfinite(self.gap))

    @cached_property
    def range(self) -> tuple[float, float]:
        """Least and greatest height; (inf, -inf) where all is transparent."""
        if not np.isfinite(self.height).any():
            return np.inf, -np.inf
        return float(np.nanmin(self.height)), float(np.nanmax(self.height))

    @cached_property
    def pitch(self) -> float:
        """Size of a texel in scene units, made so large that a wall's picture fits."""
        low, high = self.range
        texel = 0.5 * (np.linalg.norm(self.frame.a) + np.linalg.norm(self.frame.b))
        return max(float(texel), (high - low) / 2048.0)

    @cached_property
    def breaks(self) -> Array:
        """(H, W) uint8: bit 0 where a texel is not joined to its right neighbour, bit 1 where not to the one below."""
        out = np.zeros(self.height.shape, np.uint8)
        out[:, :-1] = np.abs(np.diff(self.height, axis=1)) > self.gap
        out[:-1] |= (np.abs(np.diff(self.height, axis=0)) > self.gap).astype(np.uint8) << 1
        return out

    @cached_property
    def codes(self) -> tuple[Array, Array]:
        """(H, W) uint8 indices of quantised heights and the (256,) float32 height of each; 255 = transparent.

        Source: oliveira2000, sec. 3.1: min + index * (max - min) / 254, here with the nearest index.
        """
        low, high = self.range if self.range[0] <= self.range[1] else (0.0, 0.0)
        step = (high - low) / 254.0 or 1.0
        index = np.where(np.isnan(self.height), 255, np.rint((np.nan_to_num(self.height, nan=low) - low) / step))
        table = (low + step * np.arange(256)).astype(np.float32)
        table[255] = np.nan
        return index.astype(np.uint8), table

    @cached_property
    def swapped(self) -> Relief:
        """The same texture with rows and columns swapped."""
        frame = ParallelFrame(self.frame.origin, self.frame.b, self.frame.a, self.frame.f)
        return replace(self, frame=frame, height=np.ascontiguousarray(self.height.T))

    def jump(self, face: Face, view: Sight) -> float:
        """Greatest difference of neighbouring shifts on one surface, over (1 + g)^2; see `prewarp_view`."""
        away = abs((view.eye[1] if face.wall else view.eye[2]) - face.at)
        return JUMP * (1.0 if face.wall else self.pitch) / max(away, 1e-30)


def build_relief(source: ReliefTexture | LayeredDepthImage | SpiralTexture) -> Relief:
    """Take the first layer of a source.

    Raises
    ------
    RendererError
        Its frame is a perspective one, or it is too large.
    """
    if isinstance(source, SpiralTexture):
        source = source.layers
    if max(source.height.shape if isinstance(source, ReliefTexture) else source.shape) > prewarp.SPAN:
        raise RendererError(f"a texture has more than {prewarp.SPAN} texels on a side; cut it or halve its resolution")
    if isinstance(source, ReliefTexture):
        return Relief(source.frame, source.height, source.color, np.inf, False)
    if not isinstance(source.frame, ParallelFrame):
        raise RendererError(
            "renderer 'prewarp' takes parallel frames; this texture has a perspective one: use renderer 'ldi', "
            "or resample it with 'ibrpipe relief range'"
        )
    first, some = source.offsets[:, :-1], np.diff(source.offsets, axis=1) > 0
    height = np.full(source.shape, np.nan, np.float32)
    color = np.zeros((*source.shape, 3), np.float32)
    height[some], color[some] = source.depth[first[some]], source.color[first[some]]
    texel = max(np.linalg.norm(source.frame.a), np.linalg.norm(source.frame.b))
    return Relief(source.frame, height, color, GAP * float(texel), True)
