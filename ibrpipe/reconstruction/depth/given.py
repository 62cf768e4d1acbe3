"""Depth maps that come with the capture: of an RGB-D camera, or a COLMAP dense workspace that is the capture folder."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ibrpipe.errors import CaptureError
from ibrpipe.io.dense import DepthMap, Workspace, read_map, write_map
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


def lacking(views: Sequence[View], maps: Sequence[DepthMap]) -> list[str]:
    """Say in one line which photos have no given depth; nothing where all have some.

    Raises
    ------
    CaptureError
        No map holds any depth.
    """
    empty = {each.view.name for each in maps if not (read_map(each.depth) > 0).any()}
    if len(empty) == len(maps):
        first = maps[0].view.depth or maps[0].depth
        others = f", nor in the other {len(maps) - 1}" if len(maps) > 1 else ""
        raise CaptureError(
            f"{first}: no pixel has depth in this map{others}; expected distances along the camera's axis in scene "
            "units, 0 = unknown: replace the maps, or find depth in the photos with geometry.use_given_depth=false"
        )
    known = {each.view.name for each in maps}
    without = [view.name for view in views if view.name not in known or view.name in empty]
    if not without:
        return []
    named = ", ".join(without[:3]) + (f" and {len(without) - 3} more" if len(without) > 3 else "")
    return [
        f"{len(without)} of {len(views)} photos have no depth ({named}): {len(views) - len(known)} without a map, "
        f"{len(empty)} with an empty one; what only they see stays open: give theirs, or find all depth in the photos "
        "with geometry.use_given_depth=false"
    ]


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
