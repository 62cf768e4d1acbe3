"""An asset folder as exporters of surfaces want it: the asset, the photos beside it, and how it is placed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ibrpipe.export.asset_folders import name_of
from ibrpipe.export.page.exporter import units_of
from ibrpipe.export.page.surface import sample_places
from ibrpipe.export.page.view import FIELD_OF_VIEW
from ibrpipe.export.surface.colors import sphere
from ibrpipe.export.surface.fidelity import Fidelity, measure
from ibrpipe.export.surface.placement import gltf_from_world, metres_of, up_of
from ibrpipe.io.assets import read_asset
from ibrpipe.io.views import IN_RUN, ViewSet, read_views
from ibrpipe.types import Array, Asset, Camera, Frame

#: of pictures that are measured where there are no photos
AROUND, SIZE = 8, (480, 360)
#: times the radius beyond which the world's origin is not kept as the file's
FAR = 100.0


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


def read_source(folder: Path) -> Exported:
    """Read an asset folder and the run around it.

    Raises
    ------
    MissingFileError, FormatError
        The asset is missing or damaged.
    """
    asset = read_asset(folder)
    file = folder.parent / IN_RUN
    views = read_views(file) if file.is_file() else None
    units = units_of(asset)
    up = up_of([] if views is None else [view.camera for view in views.train])
    center, radius = _ball(asset)
    far = float(np.linalg.norm(center)) > FAR * radius
    placed = gltf_from_world(up, metres_of(units) or 1.0, center if far else np.zeros(3))
    return Exported(name_of(folder), asset, views, placed, units)


def _ball(asset: Asset) -> tuple[Array, float]:
    """Centre (3,) and radius of a ball that holds all samples."""
    found = [sample_places(each.layers) for each in asset.textures if len(each.layers.depth)]
    if not found:
        return np.zeros(3), 1.0
    places = np.concatenate(found)
    center = 0.5 * (places.min(axis=0) + places.max(axis=0))
    return center, float(np.linalg.norm(places - center, axis=1).max()) or 1.0


def _around(asset: Asset) -> list[Camera]:
    """Cameras all around an asset."""
    center, radius = _ball(asset)
    distance = 1.1 * radius / np.sin(np.radians(FIELD_OF_VIEW / 2))
    return [
        Camera.look_at(center + distance * toward, center, (0.0, 0.0, 1.0), FIELD_OF_VIEW, *SIZE)
        for toward in sphere(AROUND)
    ]
