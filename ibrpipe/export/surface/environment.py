"""What an asset mirrors, as pictures of the surroundings: equirectangular, Radiance HDR, axes of the glTF file."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from ibrpipe.core.reflection.directions import pad
from ibrpipe.export.surface.colors import table_lights
from ibrpipe.export.surface.placement import rotation_of
from ibrpipe.types import Array
from ibrpipe.types.reflection import ReflectedLight

#: rows of a picture for every cell along a side of a table
ROWS = 2


def surroundings(light: ReflectedLight, gltf_from_world: Array) -> list[bytes]:
    """Return one HDR file for every table.

    Column and row of the picture of height h are ``u = 0.5 + atan2(z, x) / 2 pi`` and ``v = acos(y) / pi`` of a
    direction in glTF's axes, times 2 h and h; light is linear, as the surface blurs it already.
    """
    height = ROWS * light.tables.shape[1]
    v, u = np.meshgrid((np.arange(height) + 0.5) / height, (np.arange(2 * height) + 0.5) / (2 * height), indexing="ij")
    around, down = 2.0 * np.pi * (u - 0.5), np.pi * v
    directions = np.stack([np.sin(down) * np.cos(around), np.cos(down), np.sin(down) * np.sin(around)], axis=-1)
    turn = rotation_of(gltf_from_world)
    world = directions.reshape(-1, 3) @ turn
    return [_hdr(table_lights(table, world).reshape(height, 2 * height, 3)) for table in pad(light.tables)]


def _hdr(picture: Array) -> bytes:
    from ibrpipe.io.photos.images import write_hdr

    with TemporaryDirectory() as folder:
        path = Path(folder) / "surroundings.hdr"
        write_hdr(path, picture.astype(np.float32))
        return path.read_bytes()
