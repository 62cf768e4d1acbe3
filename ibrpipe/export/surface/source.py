"""An asset folder as exporters of surfaces want it: the asset, the photos beside it, and how it is placed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ibrpipe.core.directions import spread_directions
from ibrpipe.errors import FormatError
from ibrpipe.export.asset_folders import name_of, units_of
from ibrpipe.export.page.view import FIELD_OF_VIEW
from ibrpipe.export.surface.fidelity import Fidelity, measure
from ibrpipe.export.surface.model import shown_samples
from ibrpipe.export.surface.placement import gltf_from_world, metres_of
from ibrpipe.export.whole_file import check_file
from ibrpipe.io.assets import read_asset
from ibrpipe.io.paths import up_of
from ibrpipe.io.views import ViewSet, read_views, views_in_run
from ibrpipe.types import Array, Asset, Camera, Frame
from ibrpipe.types.bounds import ball_around, placed_samples

#: of pictures that are measured where there are no photos
AROUND, SIZE = 8, (480, 360)
#: times the radius beyond which the world's origin is not kept as the file's
FAR = 100.0
#: an axis of the world that is so near to what photos call up is taken for it, degrees
NEAR_AXIS = 20.0


@dataclass(frozen=True, eq=False)
class Exported:
    """What is exported.

    Attributes
    ----------
    name : str
    asset : Asset
    views : ViewSet or None
        The run's photos.
    gltf_from_world : (4, 4) float64
    units : str
        Name of the scene unit; empty = unknown.
    """

    name: str
    asset: Asset
    views: ViewSet | None
    gltf_from_world: Array
    units: str

    @property
    def cameras(self) -> list[Camera]:
        """Those of the photos that the asset is made from; empty = unknown."""
        return [] if self.views is None else [view.camera for view in self.views.train]

    def measure(self, draw: Callable[[Camera], Frame], diffuse: bool = False) -> Fidelity:
        """Compare what the written file shows with the asset and, where photos are at hand, with those."""
        shown = () if self.views is None else self.views.shown
        shown = tuple(view for view in shown if view.image.is_file())
        held_out = self.views is not None and bool(self.views.test)
        return measure(draw, self.asset, shown, held_out, [] if shown else _around(self.asset), diffuse)


def read_source(folder: Path, target: Path) -> Exported:
    """Read an asset folder and the run around it, to be written as the file `target`.

    Raises
    ------
    MissingFileError, FormatError
        The asset is missing, damaged, or shows nothing.
    ConfigError, ResourceError
        `target` cannot be written.
    """
    check_file(target)
    return read_exported(folder)


def read_exported(folder: Path) -> Exported:
    """Read an asset folder and the run around it.

    Raises
    ------
    MissingFileError, FormatError
        The asset is missing, damaged, or shows nothing.
    """
    asset = read_asset(folder)
    if not any(shown_samples(texture.layers).any() for texture in asset.textures):
        raise FormatError(
            f"{folder}: the asset holds no sample that a photo sees, so there is nothing to export; make it anew from "
            "photos that show it"
        )
    file = views_in_run(folder.parent)
    views = None if file is None else read_views(file)
    units = units_of(asset)
    up = up_of([] if views is None else [view.camera for view in views.train], NEAR_AXIS)
    center, radius = _ball(asset)
    far = float(np.linalg.norm(center)) > FAR * radius
    placed = gltf_from_world(up, metres_of(units) or 1.0, center if far else np.zeros(3))
    return Exported(name_of(folder), asset, views, placed, units)


def _ball(asset: Asset) -> tuple[Array, float]:
    """Centre (3,) and radius of a ball that holds all samples but a background's; 0 and 1 where there are none."""
    places = placed_samples(asset.textures, asset.info)
    return ball_around(places) if len(places) else (np.zeros(3), 1.0)


def _around(asset: Asset) -> list[Camera]:
    """Cameras all around an asset."""
    center, radius = _ball(asset)
    distance = 1.1 * radius / np.sin(np.radians(FIELD_OF_VIEW / 2))
    return [
        Camera.look_at(center + distance * toward, center, (0.0, 0.0, 1.0), FIELD_OF_VIEW, *SIZE)
        for toward in spread_directions(AROUND)
    ]
