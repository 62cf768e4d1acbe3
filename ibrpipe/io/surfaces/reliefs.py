"""Relief textures on disk: ``reliefs.json``, and one image of colour and displacement for each.

Source: oliveira2000, sec. 3.1: displacements are quantised uniformly and stored in the alpha channel, one code is kept
for what is transparent. Departure: also with 16 bits, or as floats; to the nearest level, not downward.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Literal

import numpy as np

from ibrpipe.core.color import srgb_decode, srgb_encode
from ibrpipe.errors import FormatError, IbrError, ResourceError, ValueRangeError
from ibrpipe.io.documents.reliefs import ReliefEntry, ReliefFrame, ReliefsFile
from ibrpipe.io.photos.image_files import read_stored
from ibrpipe.io.untrusted.boundary import reader
from ibrpipe.io.untrusted.inside import inside
from ibrpipe.picture_files import write_exr
from ibrpipe.types import Array, Asset, ParallelFrame, ReliefTexture, Texture
from ibrpipe.types.layers import layers_of_relief
from ibrpipe.version import VERSION

INDEX = "reliefs.json"
#: how colours and displacements are stored
Bits = Literal[8, 16, "float"]


def is_reliefs(path: str | Path) -> bool:
    """Tell whether a folder holds relief textures."""
    return (Path(path) / INDEX).is_file()


def write_reliefs(
    reliefs: Sequence[ReliefTexture],
    path: str | Path,
    names: Sequence[str] | None = None,
    *,
    bits: Bits = 16,
    joined: bool = True,
    made_from: str = "",
) -> None:
    """Write relief textures, each as one image of colour and displacement.

    Parameters
    ----------
    reliefs : sequence of ReliefTexture
    path : path
        Folder; relief textures that are there already are replaced.
    names : sequence of str, optional
        One for each; ``relief_00`` and so on unless given.
    bits : {8, 16, "float"}
        8, 16: PNG, colours as sRGB codes (clipped to 0 to 1), heights in 254 or 65534 steps; float: OpenEXR, exact.
    joined : bool
        Neighbours are one surface whatever the step between them; otherwise they are parted above 4 texels of height.
    made_from : str
        Told in the index.

    Raises
    ------
    ValueRangeError, ResourceError
        There is nothing to write, or it cannot be written.
    """
    folder = Path(path)
    if not reliefs:
        raise ValueRangeError("there are no relief textures to write; give at least one")
    if bits not in (8, 16, "float"):
        raise ValueRangeError(f"bits is {bits!r}; choose 8, 16 or 'float'")
    if folder.is_dir() and any(folder.iterdir()) and not is_reliefs(folder):
        raise ResourceError(f"{folder}: holds files but no relief textures; name another folder, or empty it")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        entries = []
        for number, relief in enumerate(reliefs):
            name = names[number] if names is not None else f"relief_{number:02d}"
            entries.append(_write(relief, folder, f"relief_{number:02d}", name, bits, joined))
        document = ReliefsFile(generator=f"ibrpipe {VERSION}", made_from=made_from, reliefs=entries)
        draft = folder / f".{INDEX}"
        draft.write_text(document.to_json() + "\n", encoding="utf-8")
        draft.replace(folder / INDEX)
    except OSError as error:
        raise ResourceError(f"{folder}: cannot write relief textures: {error.strerror or error}") from error


def _write(relief: ReliefTexture, folder: Path, stem: str, name: str, bits: Bits, joined: bool) -> ReliefEntry:
    frame = ReliefFrame(**{each: getattr(relief.frame, each).tolist() for each in ("origin", "a", "b", "f")})
    if bits == "float":
        channels = dict(zip("RGB", np.moveaxis(relief.color, 2, 0)))
        write_exr(folder / f"{stem}.exr", {**channels, "Z": relief.height})
        return ReliefEntry(name=name, file=f"{stem}.exr", frame=frame, joined=joined)
    codes, low, step = quantized(relief.height, bits)
    _write_png(folder / f"{stem}.png", relief.color, codes)
    return ReliefEntry(name=name, file=f"{stem}.png", frame=frame, low=low, step=step, joined=joined)


def quantized(height: Array, bits: int) -> tuple[Array, float, float]:
    """Return indices (H, W) of heights, the greatest code where they are NaN, the height of index 0, and the step."""
    kind, most = (np.uint8, 255) if bits == 8 else (np.uint16, 65535)
    some = height[np.isfinite(height)].astype(np.float64)
    low, high = (float(some.min()), float(some.max())) if len(some) else (0.0, 0.0)
    step = (high - low) / (most - 1) or 1.0
    index = np.rint((np.nan_to_num(height.astype(np.float64), nan=low) - low) / step)
    return np.where(np.isfinite(height), index, most).astype(kind), low, step


def _write_png(path: Path, color: Array, codes: Array) -> None:
    import cv2

    most = np.iinfo(codes.dtype).max
    rgb = np.rint(srgb_encode(np.clip(color.astype(np.float64), 0.0, 1.0)) * most).astype(codes.dtype)
    if not cv2.imwrite(str(path), np.concatenate([rgb[..., ::-1], codes[..., None]], axis=2)):
        raise ResourceError(f"{path}: cannot be written; choose another folder")


@reader("write it again")
def read_reliefs(path: str | Path) -> tuple[ReliefTexture | Texture, ...]:
    """Read relief textures.

    Parameters
    ----------
    path : path
        Folder with ``reliefs.json``.

    Returns
    -------
    tuple of ReliefTexture or Texture
        Those whose neighbours are to be parted where heights jump come as textures of one layer.

    Raises
    ------
    MissingFileError, FormatError
        The folder holds none, or they are damaged.
    """
    folder = Path(path)
    document = ReliefsFile.read(folder / INDEX, "is no list of relief textures", "relief images")
    return tuple(_read(folder, entry) for entry in document.reliefs)


def reliefs_as_asset(path: str | Path) -> Asset:
    """Read relief textures as an asset of one layer each, their neighbours parted where heights jump.

    Raises
    ------
    MissingFileError, FormatError
        As `read_reliefs`.
    """
    document = ReliefsFile.read(Path(path) / INDEX, "is no list of relief textures", "relief images")
    found = read_reliefs(path)
    textures = tuple(each if isinstance(each, Texture) else Texture(layers_of_relief(each)) for each in found)
    info = {
        "textures": [{"name": entry.name} for entry in document.reliefs],
        "units": "scene units",
        "provenance": {"made": "ibrpipe relief", "from": document.made_from},
    }
    return Asset(textures, info)


def _read(folder: Path, entry: ReliefEntry) -> ReliefTexture | Texture:
    file = inside(folder, entry.file, folder / INDEX, "write the relief textures again")
    pixels, header = read_stored(file)
    channels = [name for name in ("R", "G", "B", "Z" if file.suffix == ".exr" else "A") if name in header.channels]
    if len(channels) < 4 or (file.suffix != ".exr" and pixels.dtype not in (np.uint8, np.uint16)):
        raise FormatError(f"{file}: holds {' '.join(header.channels)}; a relief texture has colours and displacements")
    red, green, blue, last = (pixels[:, :, header.channels.index(name)] for name in channels)
    color, height = np.stack([red, green, blue], axis=2), last.astype(np.float64)
    if header.integer:
        most = np.iinfo(pixels.dtype).max
        color = srgb_decode(color / most)
        height = np.where(last == most, np.nan, entry.low + height * entry.step)
    try:
        frame = ParallelFrame(*(np.array(getattr(entry.frame, name)) for name in ("origin", "a", "b", "f")))
        relief = ReliefTexture(frame, color.astype(np.float32), height.astype(np.float32))
    except IbrError as error:
        raise FormatError(f"{file}: {error}") from error
    return relief if entry.joined else Texture(layers_of_relief(relief))
