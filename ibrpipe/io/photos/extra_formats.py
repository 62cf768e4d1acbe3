"""Photos of phones (HEIC) and raw files of cameras, read by packages that do not come with ibrpipe.

HEIC: as stored, in the colours that its profile states. Raw: developed to linear light with Rec.709 primaries and the
white balance that the camera has noted; nothing is brightened, sharpened or freed of noise.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ibrpipe.errors import FormatError, MissingFileError, ResourceError
from ibrpipe.io.photos.exif_tags import exposure_of, tags_of_bytes, tags_of_file
from ibrpipe.io.photos.image_header import ImageHeader
from ibrpipe.picture_files import LINEAR, SRGB
from ibrpipe.types import Array

HEIC_SUFFIXES = (".heic", ".heif", ".hif")
RAW_SUFFIXES = (".dng", ".cr2", ".cr3", ".nef", ".nrw", ".arw", ".raf", ".orf", ".rw2", ".pef", ".srw")
#: code points of ITU-T H.273: Display P3's primaries; the curves of sRGB and its like; those of HDR (PQ, HLG)
_P3, _HDR = 12, (16, 18)
#: LibRaw's numbers of a picture that stands on its side
_ON_SIDE = (5, 6)


@dataclass(frozen=True)
class ExtraFormat:
    """How files of one kind are read.

    Attributes
    ----------
    header : callable
        Path to `ImageHeader`.
    stored : callable
        Path to pixels (H, W, C) as they are stored, and header.
    tags : callable
        Path to the camera's notes by EXIF name.
    """

    header: Callable[[Path], ImageHeader]
    stored: Callable[[Path], tuple[Array, ImageHeader]]
    tags: Callable[[Path], dict[str, Any]]


def extra_format(path: Path) -> ExtraFormat | None:
    """Return how a file is read that OpenImageIO does not read, by its suffix; None for all others."""
    suffix = path.suffix.lower()
    if suffix in HEIC_SUFFIXES:
        return _HEIC
    return _RAW if suffix in RAW_SUFFIXES else None


def without_raw_twins(files: Iterable[Path]) -> list[Path]:
    """Leave raw files out that lie beside a finished photo of the same name: one shutter, one photo."""
    files = list(files)
    finished = {file.with_suffix("") for file in files if file.suffix.lower() not in RAW_SUFFIXES}
    return [file for file in files if file.suffix.lower() not in RAW_SUFFIXES or file.with_suffix("") not in finished]


def _module(name: str, extra: str, path: Path, remedy: str) -> Any:
    from importlib import import_module

    if not path.is_file():
        raise MissingFileError(f"{path}: the image does not exist")
    try:
        return import_module(name)
    except ImportError as error:
        raise ResourceError(
            f"{path}: reading {path.suffix} needs a package; type: pip install 'ibrpipe[{extra}]', or {remedy}"
        ) from error


def _open_heic(path: Path) -> Any:
    module = _module("pillow_heif", "heic", path, "export the photos as JPEG")
    try:
        opened = module.open_heif(path, convert_hdr_to_8bit=False)
    except (ValueError, OSError, RuntimeError, SyntaxError) as error:
        raise FormatError(f"{path}: cannot be read as HEIC ({error}); copy it again, or export it as JPEG") from error
    if (opened.info.get("nclx_profile") or {}).get("transfer_characteristics") in _HDR:
        raise FormatError(f"{path}: is an HDR picture (PQ or HLG); expected one of usual range: export it as JPEG")
    return opened


def _heic_header(path: Path) -> ImageHeader:
    return _header_of_heic(_open_heic(path))


def _header_of_heic(opened: Any) -> ImageHeader:
    """Return the header; the file's turns are obeyed by the decoder, so that nothing is left of them."""
    channels = tuple({"L": "Y"}.get(letter, letter) for letter in opened.mode.split(";")[0])
    width, height = opened.size
    primaries = (opened.info.get("nclx_profile") or {}).get("color_primaries")
    return ImageHeader(
        width,
        height,
        channels,
        integer=True,
        orientation=1,
        color_space="srgb_p3d65_scene" if primaries == _P3 else SRGB,
        metadata=exposure_of(tags_of_bytes(opened.info.get("exif") or b"")),
        profile=opened.info.get("icc_profile"),
    )


def _heic_stored(path: Path) -> tuple[Array, ImageHeader]:
    opened = _open_heic(path)
    pixels = np.asarray(opened)
    return pixels.reshape(*pixels.shape[:2], -1), _header_of_heic(opened)


def _heic_tags(path: Path) -> dict[str, Any]:
    return tags_of_bytes(_open_heic(path).info.get("exif") or b"")


def _open_raw(path: Path) -> Any:
    module = _module("rawpy", "raw", path, "develop the photos to TIFF or JPEG")
    try:
        return module.imread(str(path))
    except Exception as error:  # LibRaw's own, which share no class with anything
        raise FormatError(f"{path}: cannot be read as a raw photo ({error}); develop it to TIFF or JPEG") from error


def _header_of_raw(opened: Any, path: Path) -> ImageHeader:
    sizes = opened.sizes
    turned = sizes.flip in _ON_SIDE
    width, height = (sizes.iheight, sizes.iwidth) if turned else (sizes.iwidth, sizes.iheight)
    return ImageHeader(
        width, height, ("R", "G", "B"), True, 1, LINEAR, exposure_of({**_noted(opened), **tags_of_file(path)})
    )


def _noted(opened: Any) -> dict[str, Any]:
    """Return what LibRaw knows of the exposure, for files that are no TIFF; 0 = unknown."""
    notes = opened.other
    figures = {"ExposureTime": notes.shutter_speed, "FNumber": notes.aperture}
    figures |= {"PhotographicSensitivity": notes.iso_speed, "FocalLength": notes.focal_length}
    return {name: value for name, value in figures.items() if value > 0}


def _raw_header(path: Path) -> ImageHeader:
    with _open_raw(path) as opened:
        return _header_of_raw(opened, path)


def _raw_stored(path: Path) -> tuple[Array, ImageHeader]:
    with _open_raw(path) as opened:
        header = _header_of_raw(opened, path)
        primaries = _module("rawpy", "raw", path, "").ColorSpace.sRGB
        try:
            pixels = opened.postprocess(
                gamma=(1, 1), no_auto_bright=True, output_bps=16, use_camera_wb=True, output_color=primaries
            )
        except Exception as error:
            raise FormatError(f"{path}: cannot be developed ({error}); develop it to TIFF or JPEG") from error
    return pixels, header


def _raw_tags(path: Path) -> dict[str, Any]:
    with _open_raw(path) as opened:
        return {**_noted(opened), **tags_of_file(path)}


_HEIC = ExtraFormat(_heic_header, _heic_stored, _heic_tags)
_RAW = ExtraFormat(_raw_header, _raw_stored, _raw_tags)
