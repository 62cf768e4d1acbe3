"""Cameras around an asset, for scripts."""

from __future__ import annotations

from typing import Any

from ibrpipe.errors import ConfigError, closest
from ibrpipe.io.paths import OrbitSpec
from ibrpipe.io.paths import orbit as orbit_path
from ibrpipe.types import Asset, Camera


def orbit(asset: Asset, n: int = 120, **settings: Any) -> tuple[Camera, ...]:
    """Return `n` cameras on a circle around an asset, so far away that all of it is in every picture.

    Parameters
    ----------
    asset : Asset
    n : int
        Number of cameras.
    **settings
        Those of `ibrpipe.io.paths.OrbitSpec`: elevation, azimuth, sweep and fov in degrees, distance in scene units,
        width and height in pixels, up ("z" unless given).

    Raises
    ------
    ConfigError
        A setting is unknown or out of range.
    ValueRangeError
        The asset is empty.
    """
    known = [name for name in OrbitSpec.__dataclass_fields__ if name != "frames"]
    for name in settings:
        if name not in known:
            raise ConfigError(f"orbit: there is no setting {name!r}; {closest(name, known)}")
    path = orbit_path(OrbitSpec(frames=n, **settings), asset.bounds)
    return tuple(camera for _, camera in path)
