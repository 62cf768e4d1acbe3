"""What an image file says of itself before its pixels are read."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class ImageHeader:
    """What an image file says of itself before its pixels are read.

    Attributes
    ----------
    width, height : int
        Size as stored, before any orientation tag is obeyed.
    channels : tuple of str
    integer : bool
        True for 8- and 16-bit files.
    orientation : int
        EXIF orientation 1..8; 1 = as stored.
    color_space : str
        Name of the space its colours are in, declared or implied.
    profile : bytes or None
        ICC profile, where `color_space` does not say the same.
    metadata : mapping
        EXIF figures: ``ExposureTime``, ``FNumber``, ``Exif:PhotographicSensitivity``, where present.
    """

    width: int
    height: int
    channels: tuple[str, ...]
    integer: bool
    orientation: int
    color_space: str
    metadata: Mapping[str, float] = field(default_factory=dict)
    profile: bytes | None = None

    @property
    def upright_size(self) -> tuple[int, int]:
        """(width, height) after the orientation tag is obeyed."""
        return (self.height, self.width) if self.orientation >= 5 else (self.width, self.height)

    @property
    def has_alpha(self) -> bool:
        """Whether a channel named A exists."""
        return "A" in self.channels
