"""What all work units of one depth estimation share, and where their results are kept until the maps are written."""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ibrpipe.io.dense import Workspace
from ibrpipe.io.manifest import digest
from ibrpipe.io.views import View
from ibrpipe.reconstruction.depth.image_pyramid import Picture, picture_of
from ibrpipe.reconstruction.depth.schedule import map_size, shrunk_size
from ibrpipe.reconstruction.depth.settings import DepthConfig
from ibrpipe.reconstruction.depth.view_selection import ViewSelection
from ibrpipe.types import Array

#: raised when results of earlier versions no longer fit
VERSION = 2
KEY, DONE = "key.txt", "done"


@dataclass(frozen=True, eq=False)
class Job:
    """A depth estimation.

    Attributes
    ----------
    views : tuple of View
    selections : tuple of ViewSelection
        One for each view.
    config : DepthConfig
    seed : int
    root : Path
        The dense workspace.
    """

    views: tuple[View, ...]
    selections: tuple[ViewSelection, ...]
    config: DepthConfig
    seed: int
    root: Path

    @property
    def workspace(self) -> Workspace:
        """Where the maps go."""
        return Workspace(self.root)

    @property
    def scratch(self) -> Path:
        """Folder of what is not finished yet."""
        return self.root / "stereo" / "passes"

    def picture(self, which: int, shrink: int) -> Picture:
        """Picture of a view, `shrink` times smaller than its depth map."""
        view = self.views[which]
        return picture_of(view, *shrunk_size(*map_size(view.camera, self.config.max_size), shrink))

    def state_file(self, number: int, which: int) -> Path:
        """File of planes and costs (4, H, W) float32 of a view after round `number`."""
        return self.scratch / f"{number:02d}" / f"{which:05d}.npy"

    def planes(self, number: int, which: int, rows: int = 3) -> Array:
        """First `rows` of a view's planes and costs after a round, (rows, H, W) float32."""
        stored = np.load(self.state_file(number, which), mmap_mode="r", allow_pickle=False)
        return np.array(stored[:rows])

    def key(self) -> str:
        """Hash of all that decides the result."""
        views = [_described(view) for view in self.views]
        selections = [[list(each.others), each.near, each.far] for each in self.selections]
        return digest([VERSION, views, selections, self.config.model_dump(mode="json"), self.seed])

    def resume(self) -> None:
        """Make the folders; throw away what another job has left."""
        marker, key = self.scratch / KEY, self.key()
        if not marker.is_file() or marker.read_text(encoding="utf-8") != key:
            shutil.rmtree(self.root / "stereo", ignore_errors=True)
            self.scratch.mkdir(parents=True)
            marker.write_text(key, encoding="utf-8")
        self.workspace.lay_out()

    def whole(self, number: int) -> bool:
        """Whether all views have been through a round and their planes are still there."""
        return all(self.state_file(number, which).is_file() for which in range(len(self.views)))

    def done(self) -> bool:
        """Whether this job has been finished before and its maps are there."""
        names = [view.name for view in self.views]
        kinds = (self.workspace.depth, self.workspace.normal, self.workspace.confidence)
        return (self.scratch / DONE).is_file() and all(file(name).is_file() for file in kinds for name in names)

    def finish(self) -> None:
        """Note that the maps are written, and remove the planes."""
        (self.scratch / DONE).touch()
        for folder in self.scratch.iterdir():
            if folder.is_dir():
                shutil.rmtree(folder)


def store(path: Path, array: Array) -> None:
    """Write a NumPy file that appears whole or not at all."""
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(f".{path.name}.partial")
    with partial.open("wb") as target:
        np.save(target, array)
    partial.replace(path)


def _described(view: View) -> list[object]:
    files = [path for path in (view.image, view.mask) if path is not None]
    stamps = [[str(path), path.stat().st_size, path.stat().st_mtime_ns] for path in files]
    camera = view.camera
    numbers = [camera.K.tolist(), camera.cam_from_world.tolist(), camera.width, camera.height, view.full_size]
    lens = None if view.distortion is None else [view.distortion.model, list(view.distortion.params)]
    colors = [view.factors.tolist(), view.mask_rule, view.mask_from_alpha, view.color_space]
    return [view.name, stamps, numbers, lens, *colors]
