"""Prerendered parts on disk: a document, slices and six views as tiled OpenEXR pictures, slabs as NumPy arrays.

The slices' picture has twelve channels of half floats, which hold the bytes of texels exactly; `COLUMNS` texels a row,
in the order of the slabs. The views' has a sample where that has a texel: places as floats, the rest as half floats.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ibrpipe.errors import FormatError, ResourceError
from ibrpipe.io.documents.prerendered import FormFigures, PartSlices, PrerenderedFile
from ibrpipe.io.manifest import write_text
from ibrpipe.io.photos.image_files import read_stored
from ibrpipe.io.untrusted.arrays import load_npz
from ibrpipe.io.untrusted.boundary import told
from ibrpipe.types import Array
from ibrpipe.types.prerendered import FIRST, HEIGHT, NODE, WIDTH, OrthogonalViews, Prerendered, view_axes

NAME, PICTURE, SLABS, VIEWS = "prerendered.json", "texels.exr", "slabs.npz", "views.exr"
COLUMNS, TILE = 1024, 256
CHANNELS = (
    "coverage", "albedo_R", "albedo_G", "albedo_B", "normal_X", "normal_Y", "normal_Z",
    "normal_XX", "normal_YY", "normal_XY", "normal_XZ", "normal_YZ",
)  # fmt: skip
VIEW_CHANNELS = (
    "place_X", "place_Y", "place_Z", "albedo_R", "albedo_G", "albedo_B", "normal_X", "normal_Y", "normal_Z",
)  # fmt: skip
HALVES, VIEW_KINDS = ("half",) * len(CHANNELS), ("float",) * 3 + ("half",) * 6
#: of a part's figures, the two forms
FORMS = ("slices", "views")
#: slabs and texels at the most: what a damaged file may claim
_MOST = 1 << 31


def write_prerendered(library: Prerendered, folder: Path) -> PrerenderedFile:
    """Write slices, and views where there are some, into `folder`, which is made; return the document.

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
        (folder / VIEWS).unlink(missing_ok=True)
    except OSError as error:
        raise ResourceError(f"{folder / SLABS}: cannot write: {error.strerror or error}") from error
    _write_picture(folder / PICTURE, library.texels, CHANNELS, HALVES)
    if library.views is not None:
        views = library.views
        samples = np.concatenate([views.places, views.albedo, views.normals], axis=1)
        _write_picture(folder / VIEWS, samples, VIEW_CHANNELS, VIEW_KINDS)
    document = _document(library, folder)
    write_text(folder / NAME, document.to_json() + "\n")
    return document


def _document(library: Prerendered, folder: Path) -> PrerenderedFile:
    leaks, errors = library.info.get("leaks", {}), library.info.get("errors", {})
    samples = np.zeros(len(library.names), int) if library.views is None else np.diff(library.views.firsts)
    parts = [
        PartSlices(
            name=name, center=[float(x) for x in sphere[:3]], radius=float(sphere[3]), overlap=float(overlap),
            leak=leaks.get(name, (None, None))[0], other_leak=leaks.get(name, (None, None))[1], samples=int(count),
            **{form: FormFigures(**vars(each)) for form, each in zip(FORMS, errors.get(name, ()), strict=False)},
        )
        for name, sphere, overlap, count in zip(library.names, library.spheres, library.overlaps, samples, strict=True)
    ]  # fmt: skip
    return PrerenderedFile(
        schema_version=3, parts=parts, resolutions=[int(each) for each in library.resolutions],
        directions=len(library.axes), scale=library.scale, texels=len(library.texels), slabs=len(library.slabs),
        seconds=float(library.info.get("seconds", 0.0)),
        file_bytes=sum((folder / name).stat().st_size for name in (PICTURE, SLABS)),
        views_seconds=float(library.info.get("views_seconds", 0.0)),
        views_bytes=0 if library.views is None else (folder / VIEWS).stat().st_size,
    )  # fmt: skip


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
    texels = _read_texels(folder / PICTURE, document.texels)
    views = _read_views(folder / VIEWS, document) if document.views_bytes else None
    leaks = {part.name: (part.leak, part.other_leak) for part in document.parts}
    return Prerendered(
        tuple(part.name for part in document.parts),
        np.array([(*part.center, part.radius) for part in document.parts]).reshape(-1, 4),
        np.array(document.resolutions, np.int64), view_axes(document.directions), stacks, slabs, heights, means, texels,
        document.scale, np.array([part.overlap for part in document.parts]),
        {"seconds": document.seconds, "file_bytes": document.file_bytes, "leaks": leaks}, views,
    )  # fmt: skip


def _write_picture(path: Path, values: Array, channels: tuple[str, ...], kinds: tuple[str, ...]) -> None:
    import OpenImageIO as oiio

    rows = max(1, -(-len(values) // COLUMNS))
    pixels = np.zeros((rows * COLUMNS, len(channels)), np.float32)
    pixels[: len(values)] = values
    spec = oiio.ImageSpec(COLUMNS, rows, len(channels), "float")
    spec.channelnames, spec.channelformats = channels, tuple(oiio.TypeDesc(kind) for kind in kinds)
    spec.tile_width, spec.tile_height = TILE, TILE
    spec.attribute("compression", "zip")
    spec.attribute("DateTime", "2000:01:01 00:00:00")
    target = oiio.ImageOutput.create(str(path))
    if target is None:
        raise ResourceError(f"{path}: OpenImageIO writes no OpenEXR here; install it again")
    written = target.open(str(path), spec) and target.write_image(pixels.reshape(rows, COLUMNS, len(channels)))
    if not (written and target.close()):
        raise ResourceError(f"{path}: cannot be written ({target.geterror()}); check the disk and the folder")


def _read_texels(path: Path, count: int) -> Array:
    texels = _read_picture(path, count, CHANNELS)
    if not (np.isfinite(texels).all() and texels.min(initial=0) >= 0 and texels.max(initial=0) <= 255):
        raise FormatError(f"{path}: holds numbers outside 0 to 255; prerender the scene again")
    return np.ascontiguousarray(texels.astype(np.uint8))


def _read_views(path: Path, document: PrerenderedFile) -> OrthogonalViews:
    firsts = np.cumsum([0, *(part.samples for part in document.parts)])
    samples = _read_picture(path, int(firsts[-1]), VIEW_CHANNELS).astype(np.float32)
    if not np.isfinite(samples).all() or (samples[:, 3:6] < 0).any():
        raise FormatError(f"{path}: holds numbers that are not finite, or negative colours; prerender the scene again")
    places, albedo, normals = (np.ascontiguousarray(part) for part in np.split(samples, 3, axis=1))
    return OrthogonalViews(firsts, places, albedo, normals)


def _read_picture(path: Path, count: int, channels: tuple[str, ...]) -> Array:
    """Read the first `count` rows of values (N, C) of a picture's channels."""
    pixels, header = read_stored(path)
    if pixels.ndim != 3 or set(header.channels) != set(channels) or pixels.shape[0] * pixels.shape[1] < count:
        raise FormatError(
            f"{path}: holds {pixels.shape} with channels {', '.join(header.channels)}; expected at least {count} "
            f"texels of {len(channels)} channels; prerender the scene again"
        )
    order = [header.channels.index(name) for name in channels]
    return pixels.reshape(-1, len(channels))[:count, order]


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
