"""Shared reflection on disk: tables as WebP pictures of fourth roots of light, weights as bytes or as pictures.

A table of 144 x 144 cells takes a few kilobytes. A picture's code c stands for light ``top (c / 255)^4``: fine enough
for what is mirrored dimly, and bright enough for the sun.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ibrpipe.errors import FormatError, IbrError, MissingFileError, ResourceError
from ibrpipe.io.components import Component, SampleFiles
from ibrpipe.io.reflection_weights import NAME as PICTURE
from ibrpipe.io.reflection_weights import read_weights, write_weights
from ibrpipe.io.untrusted.arrays import load_npz
from ibrpipe.io.untrusted.boundary import told
from ibrpipe.types import Array, LayeredDepthImage
from ibrpipe.types.reflection import MOST_CELLS, MOST_TABLES, ReflectedLight, Reflection

WEIGHTS = "reflection_weights.npz"
#: samples of one texture at the most: what a damaged file may claim
MOST_SAMPLES = 1 << 28


class ReflectionFiles(SampleFiles):
    """The kind "reflection" in asset folders."""

    def write(self, component: Reflection, folder: Path, quality: int) -> Mapping[str, Any]:
        """Write the weights, where there are some."""
        if component.weights is None:
            return {}
        top = float(component.weights.max(initial=0.0)) or 1.0
        codes = np.round(component.weights * (255.0 / top)).astype(np.uint8)
        try:
            np.savez_compressed(folder / WEIGHTS, weights=codes)
        except OSError as error:
            raise ResourceError(f"{folder / WEIGHTS}: cannot write: {error.strerror or error}") from error
        return {"file": WEIGHTS, "top": top}

    def write_on(
        self, component: Reflection, layers: LayeredDepthImage, folder: Path, quality: int, speed: int
    ) -> Mapping[str, Any]:
        """Write the weights, where there are some, as a picture of the layers; at quality 100 as bytes."""
        if component.weights is None or quality >= 100:
            return self.write(component, folder, quality)
        tops = write_weights(component.weights, layers, folder / PICTURE, quality, speed)
        if tops is None:
            return self.write(component, folder, quality)
        return {"file": PICTURE, "tops": tops}

    def read_on(self, entry: Component, root: Path, shared: Any, layers: LayeredDepthImage) -> Reflection:
        """Read a component on its layers, whose tables are read."""
        if entry.file is None or not entry.file.endswith(".avif"):
            return self.read(entry, root, shared)
        light, path = _light(root, shared), root / entry.file
        tops = _numbers(root, entry, "tops")
        if len(tops) != len(light.tables):
            raise FormatError(f"{root}: a reflection has {len(tops)} tops of weights for {len(light.tables)} tables")
        return _checked(path, lambda: Reflection(light, read_weights(path, layers, tops)))

    def read(self, entry: Component, root: Path, shared: Any) -> Reflection:
        """Read a component whose tables are read."""
        light = _light(root, shared)
        if entry.file is None:
            return Reflection(light)
        path, top = root / entry.file, _number(root, entry, "top")
        try:
            with told(path, "copy the asset again"):
                codes = load_npz(path, "copy the asset again", "damaged")["weights"]
        except MissingFileError as error:
            raise MissingFileError(f"{path}: no such file; it should hold the weights of a reflection") from error
        if codes.dtype != np.uint8 or codes.ndim != 2 or codes.size > MOST_SAMPLES:
            raise FormatError(f"{path}: holds {codes.dtype} {codes.shape}, expected bytes (samples, tables)")
        return _checked(path, lambda: Reflection(light, codes.astype(np.float32) * np.float32(top / 255.0)))

    def write_shared(self, shared: ReflectedLight, folder: Path, quality: int) -> Mapping[str, Any]:
        """Write one picture a table."""
        names = tuple(f"reflection_{number}.webp" for number in range(len(shared.tables)))
        tops = [float(table.max()) or 1.0 for table in shared.tables]
        for name, table, top in zip(names, shared.tables, tops, strict=True):
            codes = np.round(255.0 * (table / np.float32(top)) ** 0.25).astype(np.uint8)
            _write_webp(folder / name, codes, quality)
        return {"files": names, "tops": tops, "reflectance": list(shared.reflectance), "damping": shared.damping}

    def read_shared(self, entry: Component, root: Path) -> ReflectedLight:
        """Read the tables."""
        tops, reflectance = _numbers(root, entry, "tops"), _numbers(root, entry, "reflectance")
        if not 1 <= len(entry.files) == len(tops) <= MOST_TABLES:
            raise FormatError(
                f"{root}: reflection names {len(entry.files)} tables and {len(tops)} tops, expected 1 to {MOST_TABLES} "
                "of each; copy the asset again"
            )
        tables = [
            np.float32(top) * (_read_webp(root / file) / np.float32(255.0)) ** 4
            for file, top in zip(entry.files, tops, strict=True)
        ]
        damping = _number(root, entry, "damping")
        if len({table.shape for table in tables}) != 1:
            raise FormatError(f"{root}: tables of reflection differ in size; copy the asset again")
        return _checked(root, lambda: ReflectedLight(np.stack(tables), tuple(reflectance), damping))


def _light(root: Path, shared: Any) -> ReflectedLight:
    if not isinstance(shared, ReflectedLight):
        raise FormatError(f"{root}: a texture has reflection but the asset has no tables of it; copy it again")
    return shared


def _checked(path: Path, make: Any) -> Any:
    try:
        return make()
    except (FormatError, MissingFileError):
        raise
    except IbrError as error:
        raise FormatError(f"{path}: {error}") from error


def _numbers(root: Path, entry: Component, name: str) -> list[float]:
    """What an entry states as `name`: a list of numbers from 0 to a million."""
    stated = entry.model_dump().get(name)
    good = isinstance(stated, list | tuple) and all(type(each) in (int, float) and 0 <= each < 1e6 for each in stated)
    if stated is None or not good:
        raise FormatError(f"{root}: {name} of a reflection is {stated!r}, expected numbers; copy the asset again")
    return [float(each) for each in stated]


def _number(root: Path, entry: Component, name: str) -> float:
    return _numbers(root, entry.model_copy(update={name: [entry.model_dump().get(name)]}), name)[0]


def _write_webp(path: Path, codes: Array, quality: int) -> None:
    import cv2

    setting = 101 if quality >= 100 else quality  # above 100 is lossless
    _, data = cv2.imencode(".webp", codes[:, :, ::-1], [cv2.IMWRITE_WEBP_QUALITY, setting])
    try:
        path.write_bytes(data.tobytes())
    except OSError as error:
        raise ResourceError(f"{path}: cannot write: {error.strerror or error}") from error


def _read_webp(path: Path) -> Array:
    """(n, n, 3) uint8, R G B."""
    import cv2

    if not path.is_file():
        raise MissingFileError(f"{path}: no such file; it should hold a table of reflected light")
    codes = cv2.imdecode(np.fromfile(path, np.uint8), cv2.IMREAD_COLOR) if path.stat().st_size else None
    if codes is None or codes.shape[0] != codes.shape[1] or codes.shape[0] > MOST_CELLS:
        raise FormatError(f"{path}: no square picture of at most {MOST_CELLS} pixels a side; copy the asset again")
    return codes[:, :, ::-1]
