"""What error costs in time: the width of a texel in the picture, the number of directions, the thickness of slabs.

max1999, sec. 4, leaves this trade-off open.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from ibrpipe.bench.forest.peer import Peer
from ibrpipe.bench.forest.results import TradeoffRow
from ibrpipe.bench.forest.run import TRUTH, our_shot, peer_shot, psnr
from ibrpipe.progress import track
from ibrpipe.renderers.api import prepare, render
from ibrpipe.renderers.hierarchical.coverage import make_slices
from ibrpipe.renderers.hierarchical.nodes import scene_nodes
from ibrpipe.renderers.hierarchical.prefiltering import Slicing
from ibrpipe.synthetic.instanced.forest import forest, forest_cameras
from ibrpipe.types import Array, Camera, Scene
from ibrpipe.types.prerendered import PrerenderedScene

#: what is tried, one after the other, all else as usual
ERRORS = (0.35, 0.5, 0.7, 1.0, 1.4, 2.0)
DIRECTIONS = (24, 48, 96)
SLABS = (1.5, 3.0, 12.0)
#: pixel error where others are varied
USUAL = 0.7


@dataclass(frozen=True, eq=False)
class _Subject:
    """A forest from some cameras, and its truth."""

    scene: Scene
    shown: list[tuple[str, Camera, Array]]
    repeats: int

    def rows(self, slicing: Slicing, named: Sequence[tuple[str, float, float]]) -> list[TradeoffRow]:
        """Slice as told, draw with each pixel error: `named` holds what is varied, its value, and the pixel error."""
        library = make_slices(scene_nodes(self.scene), slicing)
        ours = prepare(PrerenderedScene(self.scene, library), "hierarchical")
        found = []
        for varied, value, pixel_error in named:
            for view, camera, truth in self.shown:
                render(ours, camera, "hierarchical", ("color", "alpha"), pixel_error=pixel_error)
                shots = [our_shot(ours, camera, pixel_error=pixel_error) for _ in range(self.repeats)]
                row = TradeoffRow(
                    varied=varied, value=value, view=view, ours_ms=min(shot.cpu for shot in shots),
                    ours_wall_ms=min(shot.wall for shot in shots), ours_psnr=psnr(shots[0].picture, truth),
                    library_bytes=library.bytes,
                )  # fmt: skip
                found.append(row)
        return found


def run_tradeoff(
    trees: int, views: Sequence[str], seed: int = 5, repeats: int = 5, size: tuple[int, int] = (640, 480)
) -> list[TradeoffRow]:
    """Measure one forest with each of `ERRORS`, `DIRECTIONS` and `SLABS`, all else as usual, from several cameras.

    Raises
    ------
    ResourceError
        Embree, which makes the truth, is not installed.
    """
    scene, cameras, usual = forest(trees, seed), forest_cameras(trees, *size), Slicing()
    peer = Peer(scene_nodes(scene), scene.lighting)
    shown = [(view, cameras[view], peer_shot(peer, cameras[view], TRUTH).picture) for view in views]
    subject = _Subject(scene, shown, repeats)
    named = [("pixel_error", error, error) for error in ERRORS]
    named += [("directions", usual.directions, USUAL), ("slab_texels", usual.slab_texels, USUAL)]
    rows = subject.rows(usual, named)
    for count in track(DIRECTIONS, "directions"):
        rows += subject.rows(replace(usual, directions=count), [("directions", count, USUAL)])
    for texels in track(SLABS, "slabs"):
        rows += subject.rows(replace(usual, slab_texels=texels), [("slab_texels", texels, USUAL)])
    return rows
