"""Checked photographs with cameras: the file ``views.json`` and the pixels it leads to.

Pixels stay in the photo files; `load_view` reads one photo at a time and returns it as a pinhole camera sees it: linear
light, undistorted, exposure compensated, at the size that ``view.camera`` states.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal, TypeVar

import numpy as np

from ibrpipe.errors import CaptureError, FormatError
from ibrpipe.io.cameras.lenses import Lens, photo_positions
from ibrpipe.io.documents import views as documents
from ibrpipe.io.photos.images import read_coverage, read_depth, read_image
from ibrpipe.io.photos.threshold_masks import threshold_mask
from ibrpipe.io.untrusted.boundary import reader
from ibrpipe.types import Array, Camera

#: key of `ViewSet.info`: why photos were brought to one exposure; absent = they were not
PHOTOMETRY = "photometry"
#: the file in a run's folder as ingest writes it; all of them, the latest first
INGESTED = "ingest/views.json"
IN_RUN = ("photometry/views.json", INGESTED)
MaskRule = Literal["coverage", "nonzero"]
#: how many training photos are shown where none is held out
STAND_INS = 8
T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class View:
    """A photograph, where it was taken from, and how its file becomes a pinhole picture.

    Attributes
    ----------
    name : str
        Unique among the train or among the test views, fit for a file name.
    camera : Camera
        Undistorted pinhole camera at the size that `load_view` returns.
    image : Path
    mask : Path or None
        Mask file; None with `mask_from_alpha` False means that the whole photo counts.
    mask_from_alpha : bool
        The photo's own alpha is the mask.
    mask_rule : {"coverage", "nonzero"}
        Mask values are coverage, or everything but zero counts fully (COLMAP's and OpenMVS's rule).
    mask_threshold : float or None
        Without a mask: what is brighter than this (display code, 0..1) is the object.
    gain : float
        Linear factor that undoes the photo's exposure.
    white_balance : (float, float, float)
        Linear factors of red, green and blue beside it.
    color_space : str or None
        None: what the file declares.
    distortion : Lens or None
        The photo's own camera model where it is not a pinhole.
    oriented : bool
        The file's orientation tag is obeyed (cameras usually count pixels as stored: False).
    full_size : (int, int) or None
        (width, height) of the undistorted picture before it is shrunk to the camera's size; None = not shrunk.
    depth : Path or None
        Known depth along camera z: the truth of test views, or what a depth camera has measured.
    held_out : bool
        For measuring only, never for making the asset.
    """

    name: str
    camera: Camera
    image: Path
    mask: Path | None = None
    mask_from_alpha: bool = False
    mask_rule: MaskRule = "coverage"
    mask_threshold: float | None = None
    gain: float = 1.0
    white_balance: tuple[float, float, float] = (1.0, 1.0, 1.0)
    color_space: str | None = None
    distortion: Lens | None = None
    oriented: bool = False
    full_size: tuple[int, int] | None = None
    depth: Path | None = None
    held_out: bool = False

    def __repr__(self) -> str:
        """Return the name, the size, and whether it is held out."""
        held = ", held out" if self.held_out else ""
        return f"View({self.name!r}, {self.camera.width} x {self.camera.height}{held})"

    @property
    def masked(self) -> bool:
        """The photo comes with a mask of any kind."""
        return self.mask is not None or self.mask_from_alpha or self.mask_threshold is not None

    @property
    def factors(self) -> Array:
        """(3,) float32: what linear red, green and blue of the file are multiplied by."""
        return np.float32(self.gain) * np.asarray(self.white_balance, np.float32)

    @property
    def full_camera(self) -> Camera:
        """The camera before shrinking."""
        return self.camera if self.full_size is None else self.camera.resized(*self.full_size)

    @property
    def photo_size(self) -> tuple[int, int]:
        """(width, height) that the photo file must have."""
        if self.distortion is not None:
            return self.distortion.width, self.distortion.height
        return self.full_camera.width, self.full_camera.height


@dataclass(frozen=True, eq=False)
class ViewSet:
    """All views of a capture.

    Attributes
    ----------
    train, test : tuple of View
    mesh : Path or None
        Triangle mesh in the cameras' world.
    info : mapping
        What else is known: ``units``, ``capture``, ``exposure``, ``photometry``, ``notes``.
    """

    train: tuple[View, ...]
    test: tuple[View, ...] = ()
    mesh: Path | None = None
    info: Mapping[str, Any] = field(default_factory=dict)

    def __repr__(self) -> str:
        """Return how many photos there are."""
        return f"ViewSet({len(self.train)} photos, {len(self.test)} held out)"

    @property
    def shown(self) -> tuple[View, ...]:
        """The held-out views; where there are none, some training photos in their stead, evenly spread."""
        return self.test or tuple(spread(self.train, STAND_INS))


def views_in_run(run: Path) -> Path | None:
    """Return the views file of a run folder that the last stage to change it wrote; None where there is none."""
    return next((run / place for place in IN_RUN if (run / place).is_file()), None)


def spread(items: Sequence[T], count: int) -> list[T]:
    """Return at most `count` of the items, evenly spread, in order."""
    if len(items) <= count:
        return list(items)
    return [items[(2 * index + 1) * len(items) // (2 * count)] for index in range(count)]


def hold_out_advice(count: int) -> int | None:
    """Return an `every` by which at least two of `count` photos are held out and two stay; None for fewer than four."""
    return max(3, count // 2) if count >= 4 else None


def shrink_view(view: View, max_pixels: int | None) -> View:
    """Return the view at no more than `max_pixels` pixels, its shape kept; None = as it is."""
    width, height = view.camera.width, view.camera.height
    if max_pixels is None or width * height <= max_pixels:
        return view
    scale = math.sqrt(max_pixels / (width * height))
    smaller = view.camera.resized(max(1, int(width * scale)), max(1, int(height * scale)))
    return replace(view, camera=smaller, full_size=view.full_size or (width, height))


def load_view(view: View) -> tuple[Array, Array]:
    """Read a photo as its pinhole camera sees it.

    Returns
    -------
    color : (H, W, 3) float32
        Linear Rec.709, non-negative, exposure compensated.
    mask : (H, W) float32
        Coverage 0..1: the mask file or alpha, 0 where undistortion finds no pixel, else 1.

    Raises
    ------
    MissingFileError, FormatError, CaptureError
        A file is missing or damaged, or has another size than the camera states.
    """
    pixels = read_image(view.image, view.color_space, view.oriented)
    _check_size(view.image, pixels.shape, view.photo_size)
    colour = pixels[:, :, :3] if pixels.shape[2] >= 3 else np.repeat(pixels[:, :, :1], 3, axis=2)
    colour, mask = _undistorted(np.ascontiguousarray(colour), _coverage(view, pixels), view)
    colour, mask = _shrunk(colour, view.camera), _shrunk(mask, view.camera)
    if not np.isfinite(colour).all():
        raise FormatError(f"{view.image}: the photo holds NaN or infinite pixels; repair it")
    return np.maximum(colour, 0.0) * view.factors, np.clip(mask, 0.0, 1.0)


def load_depth(view: View) -> Array:
    """Read a view's known depth: (H, W) float32 along camera z in scene units, +inf where nothing is.

    Depth cameras have fewer pixels than photos: maps of another size but the photo's shape are taken by nearest pixel.

    Raises
    ------
    CaptureError
        The view has no depth file, or it has another shape than the photo.
    """
    if view.depth is None:
        raise CaptureError(f"view {view.name} has no true depth; ask only views whose depth is set")
    depth = read_depth(view.depth)
    width, height = view.photo_size
    if abs(depth.shape[1] * height - depth.shape[0] * width) > 0.01 * depth.shape[1] * height:
        _check_size(view.depth, depth.shape, view.photo_size)
    depth = _nearest(depth, width, height)
    if view.distortion is not None:
        x, y = photo_positions(view.distortion, view.full_camera)
        inside = x > -1e3
        rows = np.clip(np.rint(y), 0, depth.shape[0] - 1).astype(np.int64)
        columns = np.clip(np.rint(x), 0, depth.shape[1] - 1).astype(np.int64)
        depth = np.where(inside, depth[rows, columns], np.float32(np.inf))
    return _nearest(depth, view.camera.width, view.camera.height)


def write_views(views: ViewSet, path: Path) -> None:
    """Write ``views.json``; a mesh beside it is stored by a relative path, photos below their common folder."""
    root = Path(views.info["capture"]) if "capture" in views.info else None
    document = documents.Views(
        schema=1,
        root=str(root) if root else "",
        mesh=None if views.mesh is None else _relative(views.mesh, path.parent),
        info=dict(views.info),
        train=[_document_of(view, root) for view in views.train],
        test=[_document_of(view, root) for view in views.test],
    )
    path.write_text(document.to_json() + "\n", encoding="utf-8")


@reader("run the ingest stage again")
def read_views(path: Path) -> ViewSet:
    """Read ``views.json``.

    Raises
    ------
    MissingFileError, FormatError
        The file does not exist or is not what `write_views` writes.
    """
    document = documents.Views.read(path, "not a views file", "ingest")
    root = Path(document.root) if document.root else path.parent
    mesh = None if document.mesh is None else path.parent / document.mesh
    train = tuple(_view_of(entry, root) for entry in document.train)
    test = tuple(_view_of(entry, root) for entry in document.test)
    return ViewSet(train, test, mesh, document.info)


def _coverage(view: View, pixels: Array) -> Array:
    """The photo's mask before undistortion, (H, W) float32."""
    if view.mask is not None:
        mask = read_coverage(view.mask, view.oriented)
        _check_size(view.mask, mask.shape, view.photo_size)
    elif view.mask_from_alpha and pixels.shape[2] in (2, 4):
        mask = np.ascontiguousarray(pixels[:, :, -1])
    elif view.mask_threshold is not None:
        return threshold_mask(
            pixels[:, :, :3] if pixels.shape[2] >= 3 else pixels[:, :, :1].repeat(3, 2), view.mask_threshold
        )
    else:
        return np.ones(pixels.shape[:2], np.float32)
    return (mask > 0).astype(np.float32) if view.mask_rule == "nonzero" else mask


def _undistorted(colour: Array, mask: Array, view: View) -> tuple[Array, Array]:
    if view.distortion is None:
        return colour, mask
    import cv2

    x, y = photo_positions(view.distortion, view.full_camera)
    settings = {"interpolation": cv2.INTER_LINEAR, "borderMode": cv2.BORDER_REPLICATE}
    inside = x > -1e3
    colour = cv2.remap(colour, x, y, **settings) * inside[:, :, None]
    return colour, cv2.remap(mask, x, y, **settings) * inside.astype(np.float32)


def _shrunk(picture: Array, camera: Camera) -> Array:
    if picture.shape[:2] == (camera.height, camera.width):
        return picture
    import cv2

    return cv2.resize(picture, (camera.width, camera.height), interpolation=cv2.INTER_AREA)


def _nearest(depth: Array, width: int, height: int) -> Array:
    rows = ((np.arange(height) + 0.5) * depth.shape[0] / height).astype(np.int64)
    columns = ((np.arange(width) + 0.5) * depth.shape[1] / width).astype(np.int64)
    return np.ascontiguousarray(depth[rows][:, columns])


def _check_size(path: Path, shape: tuple[int, ...], expected: tuple[int, int]) -> None:
    if (shape[1], shape[0]) != expected:
        raise CaptureError(
            f"{path}: is {shape[1]} x {shape[0]} pixels but the camera states {expected[0]} x {expected[1]}; "
            "use the files that were calibrated, or calibrate again"
        )


def _relative(path: Path, folder: Path | None) -> str:
    if folder is not None and path.is_relative_to(folder):
        return path.relative_to(folder).as_posix()
    return str(path)


def _document_of(view: View, root: Path | None) -> documents.View:
    lens = view.distortion
    return documents.View(
        name=view.name,
        image=_relative(view.image, root),
        mask=None if view.mask is None else _relative(view.mask, root),
        mask_from_alpha=view.mask_from_alpha,
        mask_rule=view.mask_rule,
        mask_threshold=view.mask_threshold,
        gain=view.gain,
        white_balance=view.white_balance,
        color_space=view.color_space,
        oriented=view.oriented,
        full_size=view.full_size,
        depth=None if view.depth is None else _relative(view.depth, root),
        held_out=view.held_out,
        width=view.camera.width,
        height=view.camera.height,
        K=view.camera.K.tolist(),
        cam_from_world=view.camera.cam_from_world.tolist(),
        distortion=None if lens is None else (lens.model, list(lens.params), lens.width, lens.height),
    )


def _view_of(entry: documents.View, root: Path) -> View:
    lens = entry.distortion
    return View(
        name=entry.name,
        camera=Camera(np.array(entry.K), np.array(entry.cam_from_world), entry.width, entry.height),
        image=root / entry.image,
        mask=None if entry.mask is None else root / entry.mask,
        mask_from_alpha=entry.mask_from_alpha,
        mask_rule=entry.mask_rule,
        mask_threshold=entry.mask_threshold,
        gain=entry.gain,
        white_balance=entry.white_balance,
        color_space=entry.color_space,
        distortion=None if lens is None else Lens(lens[0], tuple(lens[1]), lens[2], lens[3]),
        oriented=entry.oriented,
        full_size=entry.full_size,
        depth=None if entry.depth is None else root / entry.depth,
        held_out=entry.held_out,
    )
