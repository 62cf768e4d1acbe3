"""Depth maps that come with the capture: of an RGB-D camera, or a COLMAP dense workspace that is the capture folder."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ibrpipe.io.dense import DepthMap, Workspace, write_map
from ibrpipe.io.views import View, load_depth
from ibrpipe.progress import track

#: kinds of COLMAP's maps, best first
KINDS = ("geometric", "photometric")


def given_maps(views: Sequence[View], capture: Path | None, workspace: Workspace) -> tuple[tuple[DepthMap, ...], str]:
    """Return the depth maps that the capture holds and where they come from; none where it holds none.

    Maps of RGB-D cameras (``depth/*.exr|npy`` beside ``images/``) are copied to `workspace` in its own layout; those of
    COLMAP are read where they are.
    """
    if capture is not None:
        found = tuple(each for each in (_colmap_map(view, capture) for view in views) if each is not None)
        if found:
            return found, "depth maps of the COLMAP dense workspace"
    measured = [view for view in views if view.depth is not None]
    if not measured:
        return (), ""
    workspace.lay_out()
    maps = []
    for view in track(measured, "given depth"):
        depth = load_depth(view)
        write_map(workspace.depth(view.name), np.where(np.isfinite(depth) & (depth > 0), depth, 0))
        maps.append(DepthMap(view, workspace.depth(view.name)))
    return tuple(maps), "depth maps of the capture"


def _colmap_map(view: View, capture: Path) -> DepthMap | None:
    images = capture / "images"
    if not view.image.is_relative_to(images):
        return None
    name = view.image.relative_to(images).as_posix()
    for kind in KINDS:
        depth, normal = (capture / "stereo" / folder / f"{name}.{kind}.bin" for folder in ("depth_maps", "normal_maps"))
        if depth.is_file():
            return DepthMap(view, depth, normal if normal.is_file() else None)
    return None
