"""Shadows and ambient occlusion of `hierarchical` against rays cast by Embree."""

from __future__ import annotations

import numba
import numpy as np
import pytest
from scipy import ndimage

import ibrpipe
from ibrpipe.bench.forest.run import psnr
from ibrpipe.bench.oracles.shadows import LitScene
from ibrpipe.core.directions import spread_directions
from ibrpipe.renderers.hierarchical.nodes import scene_nodes
from ibrpipe.renderers.hierarchical.prefiltering import Slicing, prerender_nodes
from ibrpipe.renderers.hierarchical.shadows import casting_sphere
from ibrpipe.synthetic.instanced.pieces import painted_box, painted_ground, placed, turned
from ibrpipe.synthetic.instanced.trees import tree
from ibrpipe.types import Camera, Instances, Light, Lighting, Part, ReliefTexture, Scene
from ibrpipe.types.camera import ParallelFrame
from ibrpipe.types.prerendered import PrerenderedScene

pytestmark = pytest.mark.skipif(numba.config.DISABLE_JIT, reason="minutes as plain Python; kernels are run by core")

CAMERA = Camera.look_at((4, -7, 5), (0, 0, 0.5), fov_y_deg=40, width=96, height=72)
AMBIENT = np.full(3, 0.3)


def lit_from(*directions):
    """Lights that together give level ground 0.6."""
    share = 0.6 / len(directions)
    return Lighting(AMBIENT, tuple(Light(d, np.full(3, share * np.linalg.norm(d) / d[2])) for d in directions))


def yard(lighting):
    """A box and a thin wall on a ground of the root."""
    parts = [
        Part("box", (painted_box((-0.6, -0.6, 0), (0.6, 0.6, 1.2), (0.7, 0.4, 0.3)),)),
        Part("wall", (painted_box((-1.5, -0.03, 0), (1.5, 0.03, 1.5), (0.3, 0.5, 0.7)),)),
    ]
    copies = (Instances("box", placed((0.8, -0.6, 0))), Instances("wall", placed((-0.6, 1.2, 0))))
    return Scene([*parts, Part("root", (painted_ground(30, (0.6, 0.6, 0.5)),), children=copies)], "root", lighting)


def shown(source, camera=CAMERA, **options):
    frame = ibrpipe.render(source, camera, "hierarchical", **options)
    assert np.isfinite(frame.color).all()
    return frame.color * frame.alpha[..., None]


#: shadows fall towards the camera
LIGHTS = {
    "steep": [(-0.3, 0.9, 1.0)],
    "grazing": [(-0.8, 0.6, 0.09)],  # five degrees above the ground
    "along-the-wall": [(-1.0, 0.0, 0.7)],
    "two": [(-0.3, 0.9, 1.0), (-1.0, 0.2, 0.8)],
}


@pytest.mark.parametrize("name", LIGHTS)
def test_boxes_cast_the_shadows_that_rays_find(name):
    scene = yard(lit_from(*LIGHTS[name]))
    wanted, _ = LitScene(scene).picture(CAMERA, 4)
    found, plain = (shown(scene, shadows=which, shadow_size=1024) for which in (True, False))
    # a pixel has one place and either side of an edge of a shadow is blurred by a texel: no wrong pixel has eight wrong
    # neighbours
    off, without = (np.abs(each - wanted).max(axis=-1) > 0.05 for each in (found, plain))
    assert without.mean() > 0.03
    assert off.mean() < 0.35 * without.mean()
    assert not ndimage.binary_erosion(off, np.ones((3, 3))).any()


def test_without_lights_shadows_change_nothing():
    scene = yard(Lighting(AMBIENT, ()))
    np.testing.assert_array_equal(shown(scene, shadows=True), shown(scene))


def leaves():
    """A crown of leaves, drawn from slices, three times on a ground."""
    rng = np.random.default_rng(3)
    twig = tree("maple")[:2]
    turns = [turned(rng.normal(size=3), rng.uniform(0, 6.28)) for _ in range(40)]
    crown = np.stack([placed(rng.uniform(-1.2, 1.2, 3), turn) for turn in turns])
    crowns = np.stack([placed((3.2 * n - 3.2, 0.4 * n, 2.0)) for n in range(3)])
    parts = [*twig, Part("crown", children=(Instances("maple-twig", crown),))]
    ground = painted_ground(40, (0.5, 0.5, 0.4))
    return Scene([*parts, Part("root", (ground,), children=(Instances("crown", crowns),))], "root")


@pytest.fixture(scope="module")
def crowns():
    scene = leaves()
    library = prerender_nodes(scene_nodes(scene), Slicing(48, 6.0, 3, 23))
    return ibrpipe.prepare(PrerenderedScene(scene, library), "hierarchical")


FAR = Camera.look_at((0, -60, 30), (0, 0, 1), fov_y_deg=9, width=96, height=72)


def test_crowns_from_slices_shade_the_ground_and_themselves(crowns):
    wanted, _ = LitScene(leaves()).picture(FAR, 6)
    found, plain = (shown(crowns, FAR, shadows=which) for which in (True, False))
    assert ibrpipe.render(crowns, FAR, "hierarchical").stats["slices"] > 10
    assert psnr(found, wanted) > psnr(plain, wanted) + 2
    assert float(found.mean()) == pytest.approx(float(wanted.mean()), rel=0.02)


def test_what_lights_see_is_kept_and_threads_change_no_byte(crowns):
    first = ibrpipe.render(crowns, FAR, "hierarchical", shadows=True, threads=1)
    kept = dict(crowns.data.maps)
    second = ibrpipe.render(crowns, FAR, "hierarchical", shadows=True, threads=2)
    assert first.color.tobytes() == second.color.tobytes()
    assert second.stats["shadow_milliseconds"] > 0
    assert len(kept) >= 1
    assert {key: id(each) for key, each in crowns.data.maps.items()} == {key: id(each) for key, each in kept.items()}
    ibrpipe.render(crowns, FAR, "hierarchical", shadows=True, shadow_size=256)
    assert len(crowns.data.maps) == len(kept) + 1


def test_the_sky_is_hidden_where_rays_are(crowns):
    scene = yard(Lighting(AMBIENT, ()))
    wanted, _ = LitScene(scene).picture(CAMERA, 4, sky=spread_directions(32))
    found, plain = shown(scene, occlusion=32), shown(scene)
    assert psnr(found, wanted) > psnr(plain, wanted) + 6
    both = shown(crowns, FAR, occlusion=8, shadows=True)
    assert (both <= shown(crowns, FAR, shadows=True) + 1e-6).all()


def tile():
    """A relief texture 2 wide around the origin, facing +z."""
    rows, columns = np.mgrid[0:16, 0:16] / 16
    frame = ParallelFrame(
        np.array([-1, 1, 0.0]), np.array([0.125, 0, 0]), np.array([0, -0.125, 0]), np.array([0, 0, 1.0])
    )
    return ReliefTexture(frame, np.stack([rows, columns, 0.5 + 0 * rows], axis=-1).astype(np.float32), 0.1 * rows)


def test_captured_things_keep_their_light_and_cast_shadows():
    lighting = lit_from((0.2, 0.1, 1.0))
    copies = (Instances("tile", placed((0, 0, 2.0))),)
    scene = Scene(
        [Part("tile", sources=(tile(),)), Part("root", (painted_ground(9, (0.5, 0.5, 0.5)),), children=copies)],
        "root",
        lighting,
    )
    camera = Camera.look_at((0.5, -6, 8), (0, 0, 0.5), fov_y_deg=40, width=60, height=45)
    frame = ibrpipe.render(scene, camera, "hierarchical")
    dark = ibrpipe.render(scene, camera, "hierarchical", shadows=True, occlusion=8, shadow_size=256)
    on_top = ndimage.binary_erosion(frame.depth < 9.0, np.ones((5, 5)))
    assert on_top.sum() > 50
    np.testing.assert_allclose(dark.color[on_top], frame.color[on_top], atol=1e-5)
    assert (dark.color < 0.7 * frame.color).all(axis=-1).sum() > 50


def test_maps_are_fitted_to_what_is_copied():
    scene = yard(lit_from((0, 0, 1.0)))
    nodes = scene_nodes(scene)
    data = ibrpipe.prepare(scene, "hierarchical").data
    sphere = casting_sphere(nodes, data.guide.spheres)
    assert 2.0 < sphere[3] < 4.0 < 30 < data.radius
    alone = scene_nodes(Scene([Part("root", (painted_ground(5, (1, 1, 1)),))], "root"))
    np.testing.assert_array_equal(casting_sphere(alone, np.array([[0, 0, 0, 7.0]])), [0, 0, 0, 7.0])
