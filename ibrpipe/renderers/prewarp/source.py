"""What the pre-warp needs of a source: the first layer of a parallel frame as heights, colours, and joints."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from ibrpipe.core.prewarp import rows as prewarp
from ibrpipe.errors import RendererError
from ibrpipe.renderers.levels import halved
from ibrpipe.renderers.prewarp.faces import Face, Sight
from ibrpipe.types import Array, LayeredDepthImage, ParallelFrame, ReliefTexture, Texture
from ibrpipe.types.layers import opaque

#: steps between neighbouring samples of a layered image, in texels, above which they are not joined
GAP = 4.0
#: share of texels of one height from which on the plane at that height is drawn into, and texels that are looked at
FLAT, PROBES = 0.25, 4096
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
    source : texture
        What it was made of, for the fallback.
    made : dict
        Levels of the pyramid and other forms of it, built when they are first asked for.
    """

    frame: ParallelFrame
    height: Array
    color: Array
    gap: float
    front_only: bool
    source: Any = None
    made: dict[Any, Any] = field(default_factory=dict)

    @property
    def bytes(self) -> int:
        """Bytes held beyond the source."""
        own = 0 if self.height is getattr(self.source, "height", None) else self.height.nbytes + self.color.nbytes
        return own + sum(each.bytes for each in self.made.values())

    def joined_up_to(self, texels: float | None) -> Relief:
        """The same with neighbours joined up to another step (None: as the source says)."""
        if texels is None:
            return self
        if ("gap", texels) not in self.made:
            self.made["gap", texels] = replace(self, gap=texels * self.pitch, made={})
        relief: Relief = self.made["gap", texels]
        return relief

    def level(self, number: int) -> Relief:
        """Level of the pyramid: colours and heights of 2^number x 2^number texels averaged (oliveira2000, sec. 4.3)."""
        if number <= 0 or min(self.height.shape) < 4:
            return self
        if "half" not in self.made:
            frame = ParallelFrame(self.frame.origin, 2 * self.frame.a, 2 * self.frame.b, self.frame.f)
            height, color = halved(self.height[..., None], self.height)[..., 0], halved(self.color, self.height)
            self.made["half"] = replace(self, frame=frame, height=height, color=color, gap=2 * self.gap, made={})
        half: Relief = self.made["half"]
        return half.level(number - 1)

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
    def flat(self) -> float | None:
        """The height that at least a quarter of all texels have to the bit; None where there is none."""
        some = self.height[np.isfinite(self.height)]
        if not len(some):
            return None
        heights, counts = np.unique(some[:: max(len(some) // PROBES, 1)], return_counts=True)
        often = heights[counts.argmax()]
        return float(often) if np.count_nonzero(some == often) >= FLAT * self.height.size else None

    @cached_property
    def flat_chunks(self) -> Array:
        """(H, chunks) uint8: where a chunk of texels along a row, and the one after it, all have the height `flat`."""
        rows, columns = self.height.shape
        chunks = -(-columns // prewarp.LANES)
        level = np.ones((rows, chunks * prewarp.LANES + 1), bool)
        level[:, :columns] = self.height == self.flat
        whole = (
            level[:, :-1].reshape(rows, chunks, prewarp.LANES).all(axis=2) & level[:, prewarp.LANES :: prewarp.LANES]
        )
        return whole.astype(np.uint8)

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
    def texels(self) -> Array:
        """(H W, 4) float32 colours, the fourth 0: one load a texel."""
        out = np.zeros((*self.height.shape, 4), np.float32)
        out[..., :3] = self.color
        return out.reshape(-1, 4)

    @cached_property
    def swapped(self) -> Relief:
        """The same texture with rows and columns swapped."""
        frame = ParallelFrame(self.frame.origin, self.frame.b, self.frame.a, self.frame.f)
        height, color = np.ascontiguousarray(self.height.T), np.ascontiguousarray(self.color.transpose(1, 0, 2))
        return replace(self, frame=frame, height=height, color=color, made={})

    def jump(self, face: Face, view: Sight) -> float:
        """Greatest difference of neighbouring shifts on one surface, over (1 + g)^2; see `prewarp_view`."""
        away = abs((view.eye[1] if face.wall else view.eye[2]) - face.at)
        return JUMP * (1.0 if face.wall else self.pitch) / max(away, 1e-30)


def build_relief(source: ReliefTexture | LayeredDepthImage | Texture) -> Relief:
    """Take the first layer of a source.

    Raises
    ------
    RendererError
        Its frame is a perspective one, or it is too large.
    """
    if isinstance(source, Texture):
        source = source.layers
    if max(source.height.shape if isinstance(source, ReliefTexture) else source.shape) > prewarp.SPAN:
        raise RendererError(f"a texture has more than {prewarp.SPAN} texels on a side; cut it or halve its resolution")
    if isinstance(source, ReliefTexture):
        return Relief(source.frame, source.height, source.color, np.inf, False, source)
    if not isinstance(source.frame, ParallelFrame):
        raise RendererError(
            "renderer 'prewarp' takes parallel frames; this texture has a perspective one: use renderer 'ldi', "
            "or resample it with 'ibrpipe relief range'"
        )
    frame, source = source.frame, opaque(source)
    first, some = source.offsets[:, :-1], np.diff(source.offsets, axis=1) > 0
    height = np.full(source.shape, np.nan, np.float32)
    color = np.zeros((*source.shape, 3), np.float32)
    height[some], color[some] = source.depth[first[some]], source.color[first[some]]
    texel = max(np.linalg.norm(frame.a), np.linalg.norm(frame.b))
    return Relief(frame, height, color, GAP * float(texel), True, source)
