"""What the `hierarchical` renderer does for a frame."""

from __future__ import annotations

from time import perf_counter

from ibrpipe.renderers.frames import limited_threads, make_frame
from ibrpipe.renderers.hierarchical.captured import captured_frame
from ibrpipe.renderers.hierarchical.data import HierarchicalData
from ibrpipe.renderers.hierarchical.lit import shadowed_color
from ibrpipe.renderers.hierarchical.options import HierarchicalOptions
from ibrpipe.renderers.hierarchical.picture import Shading, draw_picture
from ibrpipe.types import Camera, Frame


def draw(data: HierarchicalData, camera: Camera, outputs: tuple[str, ...], options: HierarchicalOptions) -> Frame:
    """Render one frame; see `ibrpipe.render`."""
    began = perf_counter()
    darker = (options.shadows or options.occlusion > 0) and "color" in outputs
    with limited_threads(options.threads):
        captured = captured_frame(data.captured, camera, options.threads)
        shading = Shading(data.lighting, data.shaded)
        picture = draw_picture(data, camera, shading, options, darker or "depth" in outputs, captured)
        plain = perf_counter()
        color = shadowed_color(data, camera, picture, options, captured) if darker else picture.color
    stats = {
        "milliseconds": 1e3 * (perf_counter() - began),
        **picture.counts,
        "captured": 0 if captured is None else int(captured.stats["frames"]),
    }
    if darker:
        stats["shadow_milliseconds"] = 1e3 * (perf_counter() - plain)
    return make_frame(outputs, picture.depth, color, picture.alpha, stats)
