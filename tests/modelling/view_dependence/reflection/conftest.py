"""What the tests of shared reflection are fitted to: a glossy ball and a matt wall."""

from __future__ import annotations

import numpy as np
import pytest

from ibrpipe.modelling.diffuse_refinement import sample_points
from ibrpipe.modelling.layers import LayersConfig, build_layers
from ibrpipe.modelling.plan_file import TexturePlan
from ibrpipe.modelling.rectangles import box_faces
from ibrpipe.modelling.view_dependence.reflection.fit import FitRules
from ibrpipe.modelling.view_dependence.reflection.observations import observe_pixels
from ibrpipe.renderers.scene import prepare
from ibrpipe.renderers.view_dependence.mirror import make_surface


class Stage:
    """A synthetic capture with layers of its box, and what its photos say of them."""

    rules = FitRules(size=24, epochs=8, polish=2)

    def __init__(self, measured, scene, texel):
        self.measured = measured(scene)
        caster, self.photos = self.measured.caster, self.measured.photos
        vertices = caster.mesh.vertices
        half = np.ptp(vertices, axis=0) / 2
        faces = box_faces(vertices.min(axis=0) + half, np.eye(3), half, texel)
        plans = [TexturePlan(face, 60.0, 8) for face in faces]
        exact = LayersConfig(depth_bits=32, color_bits=16)
        self.layers = [build_layers(i, plans, caster, self.photos, exact)[0] for i in range(len(plans))]
        self.scene = prepare(tuple(self.layers))
        self.surface = make_surface(self.scene, np.concatenate([each.normal for each in self.layers]))
        self.points = np.concatenate([sample_points(f, each) for f, each in zip(faces, self.layers, strict=True)])

    def observe(self, photos=None):
        return observe_pixels(self.scene, self.surface, photos or self.photos, self.rules.size)


@pytest.fixture(scope="module")
def ball(measured):
    return Stage(measured, "ball", 0.06)


@pytest.fixture(scope="module")
def wall(measured):
    return Stage(measured, "lambert", 0.06)
