"""Pictures with shadows and ambient occlusion: each light counts as much as reaches what a pixel shows."""

from __future__ import annotations

import numpy as np

from ibrpipe.core.directions import spread_directions
from ibrpipe.renderers.hierarchical.captured import captured_frame
from ibrpipe.renderers.hierarchical.data import HierarchicalData
from ibrpipe.renderers.hierarchical.options import HierarchicalOptions
from ibrpipe.renderers.hierarchical.picture import Picture, Shading, draw_picture
from ibrpipe.renderers.hierarchical.shadows import (
    LIGHT_BIAS,
    SKY_BIAS,
    SKY_SIZE,
    ShadowMaps,
    casting_sphere,
    shadow_maps,
)
from ibrpipe.types import Array, Camera, Frame, Lighting

#: numbers of `HierarchicalData.partly_shaded`: no light at all, ambient light alone; from 0 on: with one of the lights
_NONE, _AMBIENT = -2, -1


def shadowed_color(
    data: HierarchicalData, camera: Camera, whole: Picture, options: HierarchicalOptions, captured: Frame | None
) -> Array:
    """Return straight colour (H, W, 3) of a picture that was drawn without shadows, with them.

    Every pixel has one place, at its depth. Colour is linear in light: what ambient light alone makes, times the share
    of the sky that is seen, and for each light what that adds, times the share of it that arrives. Captured things keep
    the light that they were photographed in.
    """
    lighting = data.lighting

    def drawn(number: int, ambient: Array, lights: tuple[int, ...]) -> Array:
        under = Lighting(ambient, tuple(lighting.lights[n] for n in lights))
        shading = Shading(under, data.shaded_by(number))
        return draw_picture(data, camera, shading, options, False, captured).color

    every = tuple(range(len(lighting.lights)))
    color = base = drawn(_AMBIENT, lighting.ambient, ())
    if options.occlusion:
        own = drawn(_NONE, np.zeros(3), ()) if captured is not None else np.float32(0.0)
        color = own + sky_share(data, camera, whole.depth, options)[..., None] * (base - own)
    if not options.shadows:
        return np.maximum(color + (whole.color - base), 0.0)
    reach = _maps(data, options, "lights").reach(whole.depth, camera)
    for n in every:
        lit = whole.color if len(every) == 1 else drawn(n, lighting.ambient, (n,))
        color = color + reach[n][..., None] * (lit - base)
    return np.maximum(color, 0.0)


def sky_share(data: HierarchicalData, camera: Camera, depth: Array, options: HierarchicalOptions) -> Array:
    """(H, W) float32: share of the sky that is seen from each pixel's place; 1 where half of the sphere is."""
    reach = _maps(data, options, "sky").reach(depth, camera)
    return np.minimum(2.0 * reach.mean(axis=0), 1.0)


def _maps(data: HierarchicalData, options: HierarchicalOptions, of: str) -> ShadowMaps:
    """What the lights, or the sky, see; drawn once for a scene and the options that it depends on."""
    key = (of, options.mode, options.pixel_error, options.shadow_size if of == "lights" else options.occlusion)
    if key not in data.maps:
        directions, size, bias = spread_directions(options.occlusion), SKY_SIZE, SKY_BIAS
        if of == "lights":
            directions = np.array([light.direction for light in data.lighting.lights]).reshape(-1, 3)
            size, bias = options.shadow_size, LIGHT_BIAS
        dark = Shading(Lighting(np.zeros(3), ()), data.shaded_by(_NONE))

        def depth_of(seen_by: Camera) -> Array:
            captured = captured_frame(data.captured, seen_by, options.threads)
            return draw_picture(data, seen_by, dark, options, True, captured).depth

        sphere = casting_sphere(data.nodes, data.guide.spheres, data.captured)
        data.maps[key] = shadow_maps(sphere, directions, size, bias, depth_of)
    return data.maps[key]
