"""Rendered pictures."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from ibrpipe.errors import FormatError, ShapeError
from ibrpipe.picture_files import write_exr, write_png
from ibrpipe.types.arrays import Array


@dataclass(frozen=True, eq=False)
class Frame:
    """A rendered picture. What was not asked for is None.

    Attributes
    ----------
    color : (H, W, 3) float32, linear light, 0 where nothing is hit
    depth : (H, W) float32, along camera z, scene units, +inf where nothing is hit
    alpha : (H, W) float32, 1 where something is hit
    stats : mapping of figures such as ``rays``, ``hits``, ``milliseconds``
    """

    color: Array | None
    depth: Array | None
    alpha: Array | None
    stats: Mapping[str, Any] = field(default_factory=dict)

    def __repr__(self) -> str:
        """Return the size and which arrays there are; their values are left out."""
        arrays = {"color": self.color, "depth": self.depth, "alpha": self.alpha}
        there = {name: array for name, array in arrays.items() if array is not None}
        size = "".join(f"{array.shape[1]} x {array.shape[0]}: " for array in [*there.values()][:1])
        return f"Frame({size}{', '.join(there) or 'empty'})"

    @property
    def channels(self) -> dict[str, Array]:
        """What an OpenEXR file holds of the frame: R, G, B times alpha, A, Z; (H, W) each."""
        found: dict[str, Array] = {}
        if self.color is not None:
            color = self.color if self.alpha is None else self.color * self.alpha[..., None]
            found.update(zip("RGB", np.moveaxis(color, 2, 0)))
        planes = {"A": self.alpha, "Z": self.depth}
        return found | {name: plane for name, plane in planes.items() if plane is not None}

    def save(self, path: Path | str) -> None:
        """Write the frame as ``.png`` (8-bit sRGB, alpha where there is any) or ``.exr`` (linear light, A and Z too).

        Raises
        ------
        FormatError
            The name ends in something else.
        ShapeError
            The frame holds no colour.
        ResourceError
            The file cannot be written.
        """
        target = Path(path)
        if self.color is None:
            raise ShapeError(f"{target}: the frame holds no colour; render it with color among the outputs")
        if target.suffix.lower() == ".png":
            write_png(target, self.color, self.alpha)
        elif target.suffix.lower() == ".exr":
            write_exr(target, self.channels)
        else:
            raise FormatError(f"{target}: frames are saved as .png or .exr; give the file one of these endings")

    def _repr_png_(self) -> bytes | None:
        """Return the picture that notebooks show; None without colour."""
        if self.color is None:
            return None
        with TemporaryDirectory() as folder:
            self.save(Path(folder) / "frame.png")
            return (Path(folder) / "frame.png").read_bytes()
