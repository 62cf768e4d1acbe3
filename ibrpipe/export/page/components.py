"""View dependence in pages, a function a kind."""

from __future__ import annotations

import io
import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np

from ibrpipe.core.color import to_bytes
from ibrpipe.core.spiral.directions import LIMIT, closing_count
from ibrpipe.errors import FormatError
from ibrpipe.export.page.packing import Packer, foretell, neighbours
from ibrpipe.io.layer_pictures.avif import encode_avif
from ibrpipe.io.residuals import continue_smoothly
from ibrpipe.io.views import spread
from ibrpipe.types import Array, Asset, KeptPhoto, KeptPhotos, PhotoBlend, Reflection, SpiralResiduals
from ibrpipe.types.reflection import ReflectedLight

#: edge of a picture that holds residual images, texels; textures of browsers are that large everywhere
ATLAS = 2048
#: textures with residuals at most: the shader marks those that it has asked in one word
SPIRALS = 30
#: photos that are kept in a page at most, as browsers stack pictures; pixels of all; their quality
MOST_KEPT, KEPT_PIXELS, KEPT_QUALITY = 256, 40_000_000, 93
#: codes of reflected light's fourth root
LIGHTS = 1 << 12


def pack_reflection(asset: Asset, packer: Packer) -> dict[str, Any]:
    """Pack the shared tables as fourth roots, and the weights of the textures' samples."""
    light = asset.shared[Reflection.kind]
    assert isinstance(light, ReflectedLight)
    top = float(light.tables.max()) or 1.0
    codes = np.round((light.tables / top) ** 0.25 * (LIGHTS - 1)).astype(np.uint16)
    size = codes.shape[1]
    around = neighbours(np.arange(size)[:, None] * size + np.arange(size + 1))
    tables = [
        [packer.add(plane, foretell(plane, around)) for plane in np.moveaxis(table, -1, 0).reshape(3, -1)]
        for table in codes
    ]
    weights = [_weights(each.component(Reflection.kind), each.layers.offsets, packer) for each in asset.textures]
    return {
        "size": size,
        "top": top,
        "levels": LIGHTS - 1,
        "tables": tables,
        "reflectance": light.reflectance,
        "damping": light.damping,
        "textures": weights,
    }


def _weights(component: Any, offsets: Array, packer: Packer) -> dict[str, Any] | None:
    """Pack a texture's weights of the tables; None = it has no reflection."""
    if component is None:
        return None
    if component.weights is None:
        return {"tops": None, "planes": []}
    around, tops = neighbours(offsets), np.maximum(component.weights.max(axis=0, initial=0.0), 1e-6)
    codes = to_bytes(component.weights / tops)
    planes = [packer.add(plane, foretell(plane, around)) for plane in codes.T]
    return {"tops": tops.tolist(), "planes": planes}


def pack_spiral(asset: Asset, packer: Packer) -> dict[str, Any]:
    """Pack residual images, side by side in pictures of lossless WebP whose alpha says what is valid.

    Raises
    ------
    FormatError
        Residuals are linear light in floats, which no picture of a browser holds, or there are too many textures.
    """
    found = [each for each in (texture.residuals for texture in asset.textures) if each is not None]
    if any(each.texels.dtype != np.uint8 for each in found):
        raise FormatError("residuals are floats; write the asset with 8-bit residuals, as the residuals stage does")
    if len(found) > SPIRALS:
        raise FormatError(f"{len(found)} textures have residuals; a page shows at most {SPIRALS}: plan fewer")
    sizes = np.concatenate([each.sizes for each in found])
    pages, places = place_images(sizes)
    sheets = np.zeros((pages, ATLAS, ATLAS, 4), np.uint8)
    for (page, y, x), (height, width), texels in zip(places, sizes, _images(found), strict=True):
        sheets[page, y : y + height, x : x + width] = texels
    used = places[:, 1] + sizes[:, 0]
    heights = [int(used[places[:, 0] == page].max(initial=1)) for page in range(pages)]
    return {
        "atlas": ATLAS,
        "pages": [packer.add_bytes(_webp(sheet[:height])) for sheet, height in zip(sheets, heights, strict=True)],
        "textures": [_spiral(each) for each in found],
        "images": packer.add(_image_table(found, sizes, places)),
    }


def place_images(sizes: Array) -> tuple[int, Array]:
    """Place images (N, 2), height and width, in shelves: how many pictures, and (N, 3) picture, row, column of each.

    Raises
    ------
    FormatError
        One is larger than a picture.
    """
    if sizes.max(initial=0) > ATLAS:
        raise FormatError(f"a residual image is {sizes.max()} texels long; at most {ATLAS}: lower residual_scale")
    places = np.zeros((len(sizes), 3), np.int64)
    page = top = left = shelf = 0
    for n in np.lexsort((-sizes[:, 1], -sizes[:, 0])):
        height, width = sizes[n]
        if left + width > ATLAS:
            top, left, shelf = top + shelf, 0, 0
        if top + height > ATLAS:
            page, top, left, shelf = page + 1, 0, 0, 0
        places[n] = page, top, left
        left, shelf = left + width, max(shelf, height)
    return page + 1, places


def _images(found: list[SpiralResiduals]) -> Any:
    """Yield every image as (H, W, 4) uint8: residual codes, and 255 where valid."""
    for each in found:
        parts = np.zeros((len(each.texels), 4), np.uint8)
        parts[:, :3], parts[:, 3] = np.where(each.valid[:, None], each.texels, each.zero), 255 * each.valid
        for n, (height, width) in enumerate(each.sizes):
            yield parts[each.starts[n] : each.starts[n + 1]].reshape(height, width, 4)


def _image_table(found: list[SpiralResiduals], sizes: Array, places: Array) -> Array:
    """(N, 8) float32: shift along u and v per depth, in edges; width, height; column, row, picture; alpha."""
    slopes = []
    for each in found:
        edges = np.linalg.norm([each.rectangle.a, each.rectangle.b], axis=1)
        slopes.append(each.directions[:, :2] / each.directions[:, 2:] / edges)
    alphas = np.concatenate([each.alphas for each in found])
    columns = (np.concatenate(slopes), sizes[:, ::-1], places[:, ::-1], alphas[:, None])
    return np.concatenate(columns, axis=1).astype(np.float32)


def _spiral(residuals: SpiralResiduals) -> dict[str, Any]:
    """What the look-up needs to know of one texture's spiral."""
    rectangle = residuals.rectangle
    a, b = np.linalg.norm(rectangle.a), np.linalg.norm(rectangle.b)
    return {
        "rotation": [(rectangle.a / a).tolist(), (rectangle.b / b).tolist(), (-rectangle.f).tolist()],
        "origin": rectangle.origin.tolist(),
        "scale": [1 / a, 1 / b],
        "k": residuals.k,
        "limit": LIMIT if residuals.closed else np.pi / 2,
        "closing": closing_count(residuals.k) if residuals.closed else 0,
        "images": len(residuals.alphas),
        "zero": residuals.zero,
    }


def _webp(sheet: Array) -> bytes:
    """Return a picture (H, W, 4) as lossless WebP."""
    from PIL import Image

    out = io.BytesIO()
    Image.fromarray(sheet, "RGBA").save(out, "WEBP", lossless=True, exact=True, quality=80, method=4)
    return out.getvalue()


def pack_kept(asset: Asset, packer: Packer) -> dict[str, Any]:
    """Pack the photos that an asset keeps as AVIF pictures, shrunk and thinned where a browser would not hold them."""
    kept = asset.shared[PhotoBlend.kind]
    assert isinstance(kept, KeptPhotos)
    chosen = spread(kept.photos, MOST_KEPT)
    pixels = sum(photo.shown.size for photo in chosen)
    factor = max(1, int(np.ceil(np.sqrt(pixels / KEPT_PIXELS))))
    with ThreadPoolExecutor(os.cpu_count()) as pool:  # coding leaves Python to other threads
        photos = list(pool.map(lambda photo: _shrunk(photo, factor), chosen))
        pictures = list(pool.map(_kept_picture, photos))
    return {
        "top": kept.top,
        "blended": kept.blend.photos,
        "falloff": kept.blend.falloff,
        "sharpness": kept.blend.sharpness,
        "textures": [each.component(PhotoBlend.kind) is not None for each in asset.textures],
        "photos": [
            {
                "K": photo.camera.K.tolist(),
                "cam_from_world": photo.camera.cam_from_world.tolist(),
                "width": photo.camera.width,
                "height": photo.camera.height,
                "picture": packer.add_bytes(picture),
                "mask": None if photo.shown.all() else packer.add(np.packbits(photo.shown)),
            }
            for photo, picture in zip(photos, pictures, strict=True)
        ],
    }


def _kept_picture(photo: KeptPhoto) -> bytes:
    return encode_avif(continue_smoothly(photo.codes, photo.shown), KEPT_QUALITY)


def _shrunk(photo: KeptPhoto, factor: int) -> KeptPhoto:
    """Return a photo of means of `factor` x `factor` pixels."""
    import cv2

    if factor == 1:
        return photo
    camera = photo.camera.resized(-(-photo.camera.width // factor), -(-photo.camera.height // factor))
    size = (camera.width, camera.height)
    codes = cv2.resize(continue_smoothly(photo.codes, photo.shown), size, interpolation=cv2.INTER_AREA)
    shown = cv2.resize(photo.shown.astype(np.float32), size, interpolation=cv2.INTER_AREA) >= 0.5
    return KeptPhoto(camera, np.asarray(codes), np.asarray(shown))


#: kinds that pages show
KINDS: dict[str, Callable[[Asset, Packer], dict[str, Any]]] = {
    Reflection.kind: pack_reflection,
    SpiralResiduals.kind: pack_spiral,
    PhotoBlend.kind: pack_kept,
}
