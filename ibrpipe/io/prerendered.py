"""Prefiltered slices on disk: a document, their texels as a tiled OpenEXR picture, their slabs as NumPy arrays.

The picture has twelve channels of half floats, which hold the bytes of texels exactly; `COLUMNS` texels a row, in the
order of the slabs.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ibrpipe.core.hierarchy.prefilter import TEXEL
from ibrpipe.errors import FormatError, ResourceError
from ibrpipe.io.documents.prerendered import PartSlices, PrerenderedFile
from ibrpipe.io.manifest import write_text
from ibrpipe.io.photos.image_files import read_stored
from ibrpipe.io.untrusted.arrays import load_npz
from ibrpipe.io.untrusted.boundary import told
from ibrpipe.types import Array
from ibrpipe.types.prerendered import FIRST, HEIGHT, NODE, WIDTH, Prerendered, view_axes

NAME, PICTURE, SLABS = "prerendered.json", "texels.exr", "slabs.npz"
COLUMNS, TILE = 1024, 256
CHANNELS = (
    "coverage", "albedo_R", "albedo_G", "albedo_B", "normal_X", "normal_Y", "normal_Z",
    "normal_XX", "normal_YY", "normal_XY", "normal_XZ", "normal_YZ",
)  # fmt: skip
#: slabs and texels at the most: what a damaged file may claim
_MOST = 1 << 31


def write_prerendered(library: Prerendered, folder: Path) -> PrerenderedFile:
    """Write slices into `folder`, which is made; return the document.

    Raises
    ------
    ResourceError
        A file cannot be written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        np.savez_compressed(
            folder / SLABS, stacks=library.stacks, slabs=library.slabs, heights=library.heights, means=library.means
        )
    except OSError as error:
        raise ResourceError(f"{folder / SLABS}: cannot write: {error.strerror or error}") from error
    _write_picture(folder / PICTURE, library.texels)
    leaks = library.info.get("leaks", {})
    parts = [
        PartSlices(
            name=name, center=[float(x) for x in sphere[:3]], radius=float(sphere[3]), overlap=float(overlap),
            leak=leaks.get(name, (None, None))[0], other_leak=leaks.get(name, (None, None))[1],
        )
        for name, sphere, overlap in zip(library.names, library.spheres, library.overlaps, strict=True)
    ]  # fmt: skip
    document = PrerenderedFile(
        schema_version=2, parts=parts, resolutions=[int(each) for each in library.resolutions],
        directions=len(library.axes), scale=library.scale, texels=len(library.texels), slabs=len(library.slabs),
        seconds=float(library.info.get("seconds", 0.0)),
        file_bytes=sum((folder / name).stat().st_size for name in (PICTURE, SLABS)),
    )  # fmt: skip
    write_text(folder / NAME, document.to_json() + "\n")
    return document


def read_prerendered(folder: Path) -> Prerendered:
    """Read slices that `write_prerendered` wrote.

    Raises
    ------
    MissingFileError, FormatError
        A file is missing, or holds something else.
    """
    document = PrerenderedFile.read(folder / NAME, "no document of prefiltered slices", "prerender")
    stacks, slabs, heights, means = _read_slabs(folder / SLABS)
    _check_slabs(folder / SLABS, document, stacks, slabs, heights, means)
    texels = _read_picture(folder / PICTURE, document.texels)
    leaks = {part.name: (part.leak, part.other_leak) for part in document.parts}
    return Prerendered(
        tuple(part.name for part in document.parts),
        np.array([(*part.center, part.radius) for part in document.parts]).reshape(-1, 4),
        np.array(document.resolutions, np.int64), view_axes(document.directions), stacks, slabs, heights, means, texels,
        document.scale, np.array([part.overlap for part in document.parts]),
        {"seconds": document.seconds, "file_bytes": document.file_bytes, "leaks": leaks},
    )  # fmt: skip


def _write_picture(path: Path, texels: Array) -> None:
    import OpenImageIO as oiio

    rows = max(1, -(-len(texels) // COLUMNS))
    pixels = np.zeros((rows * COLUMNS, TEXEL), np.float16)
    pixels[: len(texels)] = texels
    spec = oiio.ImageSpec(COLUMNS, rows, TEXEL, "half")
    spec.channelnames = CHANNELS
    spec.tile_width, spec.tile_height = TILE, TILE
    spec.attribute("compression", "zip")
    spec.attribute("DateTime", "2000:01:01 00:00:00")
    target = oiio.ImageOutput.create(str(path))
    if target is None:
        raise ResourceError(f"{path}: OpenImageIO writes no OpenEXR here; install it again")
    written = target.open(str(path), spec) and target.write_image(pixels.reshape(rows, COLUMNS, TEXEL))
    if not (written and target.close()):
        raise ResourceError(f"{path}: cannot be written ({target.geterror()}); check the disk and the folder")


def _read_picture(path: Path, count: int) -> Array:
    pixels, header = read_stored(path)
    if pixels.ndim != 3 or set(header.channels) != set(CHANNELS) or pixels.shape[0] * pixels.shape[1] < count:
        raise FormatError(
            f"{path}: holds {pixels.shape} with channels {', '.join(header.channels)}; expected at least {count} "
            f"texels of {TEXEL} channels; prerender the scene again"
        )
    order = [header.channels.index(name) for name in CHANNELS]
    texels = pixels.reshape(-1, TEXEL)[:count, order]
    if not (np.isfinite(texels).all() and texels.min(initial=0) >= 0 and texels.max(initial=0) <= 255):
        raise FormatError(f"{path}: holds numbers outside 0 to 255; prerender the scene again")
    return np.ascontiguousarray(texels.astype(np.uint8))


def _read_slabs(path: Path) -> tuple[Array, Array, Array, Array]:
    archive = load_npz(path, "prerender the scene again", "damaged")
    with told(path, "prerender the scene again"):
        stacks, slabs, heights, means = (archive[name] for name in ("stacks", "slabs", "heights", "means"))
    return stacks, slabs, heights, means


def _check_slabs(
    path: Path, document: PrerenderedFile, stacks: Array, slabs: Array, heights: Array, means: Array
) -> None:
    """Raise `FormatError` unless every slab lies within the texels, its stack and its part."""
    count = len(document.parts) * len(document.resolutions) * document.directions
    shaped = (
        stacks.shape == (count + 1,) and slabs.shape == (document.slabs, 7) and heights.shape == (document.slabs, 2)
        and means.shape == (document.slabs, 12) and stacks.dtype == slabs.dtype == np.int64
        and heights.dtype == means.dtype == np.float32 and document.texels < _MOST
    )  # fmt: skip
    sound = shaped and stacks[0] == 0 and stacks[-1] == document.slabs and (np.diff(stacks) >= 0).all()
    if sound and document.slabs:
        sizes = slabs[:, WIDTH] * slabs[:, HEIGHT]
        parts = np.repeat(np.arange(count), np.diff(stacks)) // (len(document.resolutions) * document.directions)
        bordered = (slabs[:, WIDTH] + 2) * (slabs[:, HEIGHT] + 2)
        within = np.cumsum(bordered) - bordered
        starts = np.repeat(within[np.minimum(stacks[:-1], document.slabs - 1)], np.diff(stacks))
        most = max(document.resolutions)
        sound = (
            (slabs[:, :WIDTH] >= 0).all() and (slabs[:, WIDTH:FIRST] >= 1).all() and (slabs[:, :FIRST] <= most).all()
            and (slabs[:, FIRST] == np.cumsum(sizes) - sizes).all() and sizes.sum() == document.texels
            and (slabs[:, NODE] == parts).all() and (slabs[:, 5] == within - starts).all()
            and np.isfinite(heights).all() and np.isfinite(means).all()
        )  # fmt: skip
    if not sound:
        raise FormatError(f"{path}: does not fit its document; prerender the scene again")
