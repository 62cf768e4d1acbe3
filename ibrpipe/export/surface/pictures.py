"""The pictures of a surface model as files hold them."""

from __future__ import annotations

import io
from dataclasses import dataclass

import numpy as np

from ibrpipe.embree import MeshCaster
from ibrpipe.errors import FormatError
from ibrpipe.export.surface.model import SurfaceModel
from ibrpipe.types import Array, Mesh

#: texels along a side of an atlas at most; larger ones are shrunk
MOST_SIDE = 8192


@dataclass(frozen=True)
class Pictures:
    """PNG or WebP files: colour with alpha; normals in tangent space, green up; gloss in alpha, times gloss_scale."""

    color: bytes
    normal: bytes | None = None
    gloss: bytes | None = None
    gloss_scale: float = 1.0


def encode_pictures(model: SurfaceModel, form: str, quality: int, lit: bool) -> Pictures:
    """Return the files of a model's pictures.

    Parameters
    ----------
    form : "png" or "webp"
    quality : int
        1 to 100, of webp.
    lit : bool
        With normals and gloss.
    """
    color = encode(shrunk(model.color), form, quality)
    if not lit:
        return Pictures(color)
    normal = encode(shrunk(tangent_picture(model)), form, min(quality + 5, 100))
    if model.gloss is None:
        return Pictures(color, normal)
    top = float(model.gloss.max())
    alpha = np.rint(model.gloss / top * 255.0).astype(np.uint8)
    return Pictures(color, normal, encode(shrunk(np.dstack([np.repeat(alpha[..., None], 4, axis=2)])), "png", 0), top)


def encode(picture: Array, form: str, quality: int) -> bytes:
    """Return a picture (h, w, 3 or 4) uint8 as the bytes of a PNG or WebP file.

    Raises
    ------
    FormatError
        The form is not known to the image library at hand.
    """
    from PIL import Image

    out = io.BytesIO()
    image = Image.fromarray(picture)
    try:
        if form == "png":
            image.save(out, "PNG", optimize=True)
        else:
            lossless = quality == 100
            image.save(out, "WEBP", lossless=lossless, quality=quality, method=6, exact=True, use_sharp_yuv=True)
    except (OSError, KeyError) as error:
        raise FormatError(f"this Pillow writes no {form} ({error}); choose png") from error
    return out.getvalue()


def shrunk(picture: Array) -> Array:
    """Return a picture that is at most `MOST_SIDE` wide and high."""
    height, width = picture.shape[:2]
    if max(height, width) <= MOST_SIDE:
        return picture
    import cv2

    scale = MOST_SIDE / max(height, width)
    size = (max(1, int(width * scale)), max(1, int(height * scale)))
    return cv2.resize(picture, size, interpolation=cv2.INTER_AREA)


def tangent_picture(model: SurfaceModel) -> Array:
    """(h, w, 3) uint8: normals of the samples in the tangent space of the mesh, green up; level without a sample."""
    height, width = model.normal_picture.shape[:2]
    flat = np.column_stack([model.uv * (width, height), np.zeros(len(model.uv))])
    rows, columns = np.nonzero(model.normal_picture.any(axis=2))
    origins = np.column_stack([columns + 0.5, rows + 0.5, np.ones(len(rows))])
    hits = MeshCaster(Mesh(flat, model.faces)).cast(origins, np.broadcast_to((0.0, 0.0, -1.0), origins.shape))
    met = hits.face >= 0
    corners = model.faces[hits.face[met]]
    weights = np.column_stack([1.0 - hits.uv[met].sum(axis=1), hits.uv[met]])
    normal, along = (np.einsum("nc,ncd->nd", weights, each[corners]) for each in (model.normals, model.tangents))
    up = np.cross(normal, along)
    own = model.normal_picture[rows[met], columns[met]].astype(np.float64)
    local = np.stack([(own * axis).sum(axis=1) for axis in (along, up, normal)], axis=1)
    local[:, 2] = np.maximum(local[:, 2], 0.05)
    local /= np.linalg.norm(local, axis=1, keepdims=True)
    out = np.full((height, width, 3), (128, 128, 255), np.uint8)
    out[rows[met], columns[met]] = np.rint(127.5 * local + 127.5)
    return out
