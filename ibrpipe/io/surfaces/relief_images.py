"""Relief images: height maps as stored numbers, and folders with colour, height and normals of one material.

Heights are numbers, never colours: nothing is linearised. Integer files span 0 (lowest) to 1 (highest) of their full
scale unless a range says otherwise; float files and arrays hold heights as they are.
"""

from __future__ import annotations

import zipfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ibrpipe.errors import FormatError, MissingFileError, ShapeError, ValueRangeError
from ibrpipe.io.photos.image_files import read_stored, turned
from ibrpipe.io.photos.images import read_image
from ibrpipe.io.untrusted.arrays import load_npy, load_npz
from ibrpipe.io.untrusted.boundary import reader
from ibrpipe.types import Array

SUFFIXES = (".exr", ".tif", ".tiff", ".png", ".npy", ".npz", ".jpg", ".jpeg", ".webp", ".hdr")
#: what a file of a relief folder is called, without its suffix; the first that exists is taken
NAMES = {
    "color": ("color", "colour", "basecolor", "base_color", "albedo", "diffuse"),
    "height": ("height", "displacement", "disp", "elevation", "elevation_u16", "bump"),
    "normal": ("normal_gl", "normal_dx", "normal"),
}


@dataclass(frozen=True, eq=False)
class ReliefImages:
    """The images of one relief, all of one size.

    Attributes
    ----------
    height : (H, W) float32
        As `read_height` returns it; NaN = transparent.
    color : (H, W, 3) float32, linear, or None
    normal : (H, W, 3) float32, unit, or None
        Components along rows (right), along columns (down) and out of the surface.
    """

    height: Array
    color: Array | None
    normal: Array | None


def read_height(path: str | Path, depth_range: tuple[float, float] | None = None) -> Array:
    """Read a height map.

    Parameters
    ----------
    path : path
        8- or 16-bit image, float image (EXR: channel Z, Y or the first), ``.npy``, or ``.npz`` with one 2-D array.
    depth_range : (low, high), optional
        Heights of code 0 and of full scale (255 or 65535) of integer images, scene units; (0, 1) unless given. In
        files of floats the values 0 and 1 are taken there; unless given, floats stay as they are.

    Returns
    -------
    (H, W) float32
        NaN where the file holds NaN or its alpha is 0: transparent.

    Raises
    ------
    MissingFileError, FormatError
        The file is missing, damaged, or no height map.
    ValueRangeError
        It holds infinity, or the range is not two finite numbers.
    """
    file = Path(path)
    if depth_range is not None and not np.isfinite(depth_range).all():
        raise ValueRangeError(f"the depth range is {depth_range}; give two finite numbers, low and high")
    heights = _array_file(file) if file.suffix.lower() in (".npy", ".npz") else _image_file(file)
    if np.isinf(heights).any():
        raise ValueRangeError(f"{file}: the height map holds infinity; use NaN for transparent texels")
    if depth_range is not None:
        low, high = depth_range
        heights = low + heights * (high - low)
    return np.ascontiguousarray(heights, np.float32)


@reader("export it again")
def read_normals(path: str | Path, green_up: bool = True) -> Array:
    """Read a tangent-space normal map: (H, W, 3) float32, unit; right, down, out of the surface.

    Parameters
    ----------
    path : path
        Image with ``n = 2 c / full scale - 1``, or floats as they are.
    green_up : bool
        The file's second component points up the picture (OpenGL); otherwise down (DirectX).
    """
    pixels, header = read_stored(Path(path))
    if pixels.shape[2] < 3:
        raise FormatError(f"{path}: a normal map needs three channels, got {pixels.shape[2]}")
    normal = pixels[:, :, :3].astype(np.float64)
    if header.integer:
        normal = 2.0 * normal / np.iinfo(pixels.dtype).max - 1.0
    if green_up:
        normal[:, :, 1] = -normal[:, :, 1]
    length = np.linalg.norm(normal, axis=2, keepdims=True)
    if not (length > 0).all():
        raise ValueRangeError(f"{path}: the normal map holds vectors without a length or NaN; export it again")
    return np.ascontiguousarray(turned((normal / length).astype(np.float32), header.orientation))


@reader("export it again")
def read_relief_folder(path: str | Path, depth_range: tuple[float, float] | None = None) -> ReliefImages:
    """Read a folder that holds ``height.*`` and, where there are any, ``color.*`` and ``normal[_gl|_dx].*``.

    Parameters
    ----------
    path : path
        Folder; common other names (`NAMES`) are understood, too.
    depth_range : see `read_height`

    Raises
    ------
    MissingFileError
        No folder, or no height map in it.
    ShapeError
        The images differ in size.
    """
    folder = Path(path)
    if not folder.is_dir():
        raise MissingFileError(f"{folder}: there is no such folder; give one that holds color.png and height.png")
    height_file = _find(folder, "height")
    if height_file is None:
        raise MissingFileError(f"{folder}: holds no height map; expected one called {', '.join(NAMES['height'])}")
    height = read_height(height_file, depth_range)
    color_file, normal_file = _find(folder, "color"), _find(folder, "normal")
    color = read_color(color_file) if color_file else None
    normal = read_normals(normal_file, green_up=normal_file.stem != "normal_dx") if normal_file else None
    for file, picture in ((color_file, color), (normal_file, normal)):
        if picture is not None and picture.shape[:2] != height.shape:
            raise ShapeError(
                f"{file}: is {picture.shape[1]} x {picture.shape[0]} but {height_file.name} is {height.shape[1]} x "
                f"{height.shape[0]}; bring them to one size"
            )
    return ReliefImages(height, color, normal)


@reader("export it again")
def read_color(path: str | Path) -> Array:
    """Read a colour image without its alpha: (H, W, 3) float32, linear; grey becomes three equal channels."""
    picture = read_image(Path(path))
    picture = picture[:, :, : 3 if picture.shape[2] >= 3 else 1]
    return np.ascontiguousarray(np.broadcast_to(picture, (*picture.shape[:2], 3)))


def _find(folder: Path, kind: str) -> Path | None:
    files = {file.name.lower(): file for file in sorted(folder.iterdir()) if file.is_file()}
    names = [name + suffix for name in NAMES[kind] for suffix in SUFFIXES]
    return next((files[name] for name in names if name in files), None)


def _array_file(file: Path) -> Array:
    if not file.is_file():
        raise MissingFileError(f"{file}: the height map does not exist")
    arrays = list(load_npz(file).values()) if zipfile.is_zipfile(file) else [load_npy(file)]
    planes = [array for array in arrays if array.ndim == 2]
    if len(planes) != 1 or not np.issubdtype(planes[0].dtype, np.number) or np.iscomplexobj(planes[0]):
        raise FormatError(f"{file}: a height map is one real array (H, W), got shapes {[a.shape for a in arrays]}")
    return planes[0].astype(np.float64)


def _image_file(file: Path) -> Array:
    pixels, header = read_stored(file)
    names = header.channels
    channel = next((names.index(name) for name in ("Z", "Y") if name in names), 0)
    heights = pixels[:, :, channel].astype(np.float64)
    if header.integer:
        heights /= np.iinfo(pixels.dtype).max
    if header.has_alpha and names != ("A",):
        heights[pixels[:, :, names.index("A")] == 0] = np.nan
    return turned(heights, header.orientation)
