"""Pictures with shadows and ambient occlusion by ray casting: all copies taken apart, Embree, many samples a pixel."""

from __future__ import annotations

import numpy as np

from ibrpipe.bench.oracles.copies import triangles_of
from ibrpipe.embree import MeshCaster
from ibrpipe.types import Array, Camera, Mesh, Scene

#: by what share of the scene's size shadow rays begin off the surface
_OFF = 1e-5


class LitScene:
    """A scene taken apart, whose light is cast ray by ray."""

    def __init__(self, scene: Scene) -> None:
        corners, self._paints = triangles_of(scene)
        faces = np.arange(3 * len(corners)).reshape(-1, 3)
        self._caster, self._lighting = MeshCaster(Mesh(corners.reshape(-1, 3), faces)), scene.lighting
        self._off = _OFF * max(scene.bounds[scene.root].radius, 1e-9)

    def picture(self, camera: Camera, side: int, shadows: bool = True, sky: Array | None = None) -> tuple[Array, Array]:
        """Return premultiplied colour (H, W, 3) and coverage (H, W) of side x side samples a pixel.

        `sky` (M, 3): directions in which the sky is looked for; ambient light is that times min(1, 2 x the share seen).
        """
        color, cover = np.zeros((camera.height, camera.width, 3)), np.zeros((camera.height, camera.width))
        for j in range(side):
            for i in range(side):
                light, hit = self._sample(camera, (i + 0.5) / side, (j + 0.5) / side, shadows, sky)
                color += light
                cover += hit
        return color / side**2, cover / side**2

    def _sample(self, camera: Camera, x: float, y: float, shadows: bool, sky: Array | None) -> tuple[Array, Array]:
        """Light (H, W, 3), 0 where nothing is hit, and hits (H, W) of one ray a pixel."""
        rows, columns = np.mgrid[: camera.height, : camera.width]
        pixels = np.stack([columns + x, rows + y, np.ones(rows.shape)], axis=-1)
        rays = pixels @ camera.world_from_pixel.T
        hits = self._caster.cast(camera.center, rays)
        seen = hits.face >= 0
        normal = hits.normal[seen].astype(np.float64)
        normal[np.einsum("ni,ni->n", normal, rays[seen]) > 0] *= -1
        places = camera.center + rays[seen] * hits.t[seen][:, None]
        received = np.tile(self._lighting.ambient, (len(places), 1))
        if sky is not None:
            share = np.mean([self._reached(places, normal, direction) for direction in sky], axis=0)
            received *= np.minimum(2.0 * share, 1.0)[:, None]
        for each in self._lighting.lights:
            lit = self._reached(places, normal, each.direction) if shadows else 1.0
            received += (lit * np.maximum(normal @ each.direction, 0.0))[:, None] * each.color
        u, v = hits.uv[seen].T.astype(np.float64)
        paint = np.einsum("kn,nkc->nc", np.stack([1 - u - v, u, v]), self._paints[hits.face[seen]])
        color = np.zeros(rays.shape)
        color[seen] = paint * received
        return color, seen

    def _reached(self, places: Array, normal: Array, direction: Array) -> Array:
        """(N,) bool: whether a light in a direction reaches places; rays begin on the side of it."""
        side = np.where(normal @ direction < 0, -1.0, 1.0)[:, None]
        found = self._caster.cast(places + self._off * side * normal, np.tile(direction, (len(places), 1)))
        return found.face < 0
