"""Both forms of a scene's parts, prefiltered slices and the six views of max1999, and what either loses."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from time import perf_counter

import numpy as np

from ibrpipe.core.color import srgb_encode
from ibrpipe.core.psnr import psnr
from ibrpipe.renderers.hierarchical.coverage import make_slices
from ibrpipe.renderers.hierarchical.data import HierarchicalData
from ibrpipe.renderers.hierarchical.guide import build_guide
from ibrpipe.renderers.hierarchical.nodes import scene_nodes
from ibrpipe.renderers.hierarchical.options import HierarchicalOptions, Mode
from ibrpipe.renderers.hierarchical.orthogonal_views import RESOLUTION, orthogonal_views
from ibrpipe.renderers.hierarchical.picture import Shading, draw_picture
from ibrpipe.renderers.hierarchical.prefiltering import Slicing, is_composed
from ibrpipe.types import Array, Camera, Light, Lighting, Scene
from ibrpipe.types.prerendered import PrerenderedScene, view_axes

#: directions from which a part is drawn, and the angle of its test pictures, degrees
TESTS, _ANGLE = 5, 12.0
#: light of test pictures: ambient, and one from aside, so that normals count
_LIGHT = Lighting(np.full(3, 0.4), (Light(np.array([1.0, 0.5, 2.0]), np.full(3, 0.8)),))
#: triangles up to which a part is compared with its polygons
MOST_TRIANGLES = 10_000_000
#: a little more than one: the texels of both forms are exactly a pixel wide
_PIXEL_ERROR = 1.02


@dataclass(frozen=True)
class FormError:
    """What a form loses of a part against its polygons with 16 samples a pixel, where a texel is a pixel wide.

    Attributes
    ----------
    psnr : float or None
        Of the pictures before white, dB; None = the part has no such form.
    coverage : float or None
        Mean difference of coverage over the pixels that the part covers.
    """

    psnr: float | None
    coverage: float | None


def prerender(scene: Scene, slicing: Slicing | None = None, pool: Executor | None = None) -> PrerenderedScene:
    """Make both forms of every part that occurs more than once; `ibrpipe.render` takes the result as the scene.

    Parameters
    ----------
    scene : Scene
    slicing : Slicing, optional
        Directions, thickness of slabs, rays, finest resolution of the slices.
    pool : Executor, optional
        Takes the parts' slices one by one; without it they are made in turn. Changes no byte.

    Returns
    -------
    PrerenderedScene
        `library.info` has `seconds`, `views_seconds`, `leaks` and, by part, `errors`: `FormError` of the slices and
        of the views.
    """
    nodes = scene_nodes(scene)
    library = make_slices(nodes, slicing or Slicing(), pool)
    began = perf_counter()
    library = replace(library, views=orthogonal_views(nodes, library))
    seconds = perf_counter() - began
    errors = measure_forms(HierarchicalData(nodes, library, build_guide(nodes, library), _LIGHT))
    return PrerenderedScene(scene, replace(library, info={**library.info, "views_seconds": seconds, "errors": errors}))


def measure_forms(data: HierarchicalData) -> dict[str, tuple[FormError, FormError]]:
    """Draw every part of at most `MOST_TRIANGLES`, with its copies, from either form and from polygons, and compare."""
    library, nodes = data.library, data.nodes
    sliced = replace(data, guide=replace(data.guide, costs=np.zeros_like(data.guide.costs)))
    shading, finest = Shading(data.lighting, data.shaded), int(library.resolutions[-1])
    found = {}
    for row, name in enumerate(library.names):
        node = nodes.names.index(name)
        if nodes.triangles[node] > MOST_TRIANGLES:
            continue
        own, sphere = replace(sliced, alone=node), library.spheres[row]
        slices, views = _error(own, shading, _cameras(sphere, finest), "slices"), FormError(None, None)
        if not is_composed(nodes, node):
            views = _error(own, shading, _cameras(sphere, RESOLUTION), "reproject")
        found[name] = slices, views
    return found


def _error(data: HierarchicalData, shading: Shading, cameras: Sequence[Camera], mode: Mode) -> FormError:
    squares, off, covered = [], 0.0, 0.0
    for camera in cameras:
        (one, alpha), (exact, truth) = (_draw(data, shading, camera, each) for each in (mode, "polygons"))
        level = psnr(exact, one, (truth > 0) | (alpha > 0))
        if level is not None:
            squares.append(10 ** (-0.1 * level))
            off, covered = off + float(np.abs(alpha - truth).sum()), covered + float(truth.sum())
    if not covered:
        return FormError(None, None)
    return FormError(-10 * float(np.log10(np.mean(squares))), off / covered)


def _cameras(sphere: Array, texels: int) -> list[Camera]:
    """Cameras from which a part has as many pixels as texels, and few around it."""
    size = texels + 8
    distance = sphere[3] * size / (texels * np.tan(np.radians(_ANGLE / 2)))
    return [
        Camera.look_at(
            sphere[:3] + distance * axes[2], sphere[:3], up=axes[1], fov_y_deg=_ANGLE, width=size, height=size
        )
        for axes in view_axes(TESTS)
    ]


def _draw(data: HierarchicalData, shading: Shading, camera: Camera, mode: Mode) -> tuple[Array, Array]:
    """Colour (H, W, 3) before white, display codes up to 255, and coverage (H, W)."""
    options = HierarchicalOptions(mode=mode, pixel_error=_PIXEL_ERROR)
    picture = draw_picture(data, camera, shading, options, False, None)
    alpha = np.nan_to_num(picture.alpha)
    light = alpha[..., None] * np.nan_to_num(picture.color) + (1.0 - alpha[..., None])
    return np.round(255.0 * srgb_encode(np.clip(light, 0.0, 1.0))), alpha
