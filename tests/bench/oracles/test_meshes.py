"""The oracle of relief-mapped meshes against the plain twin, ray by ray."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
import relief_mesh_twin as twin

from ibrpipe.bench.cases import choose_cases
from ibrpipe.bench.oracles import meshes as oracle
from ibrpipe.bench.oracles.fields import pixel_centers

TWIN = {"flat": lambda source, camera: twin.cast(source, camera)[0], "shell": twin.cast_shell}


@pytest.mark.parametrize(
    ("name", "model"),
    [
        ("mesh-cut", "flat"),
        ("mesh-dual-holes", "flat"),
        ("mesh-uv-sheared", "flat"),
        ("mesh-degenerate-textures", "flat"),
        ("mesh-tiled", "shell"),
        ("mesh-size-1x1-cut", "shell"),
    ],
)
def test_oracle_equals_the_plain_twin(name, model):
    shot = choose_cases([name])[0].build()
    camera = shot.camera.resized(11, 9)
    hits = oracle.cast_relief(shot.source, oracle.relief_of(shot.source), camera, model)
    wanted = TWIN[model](shot.source, camera)
    assert np.isfinite(wanted).sum() > 20
    sure = hits.truth.clear(1e-3 * hits.texel)
    assert sure.mean() > 0.9
    np.testing.assert_allclose(hits.truth.depth[sure], wanted[sure], rtol=1e-7)  # the twin stores depth as float32


def test_position_and_rate_lead_along_the_ray():
    """The texture's position of the hit, moved along the ray, is on the polygon where the ray meets it."""
    shot = choose_cases(["mesh-eye-above"])[0].build()
    hits = oracle.cast_relief(shot.source, oracle.relief_of(shot.source), shot.camera, "flat")
    there = np.isfinite(hits.truth.depth)
    position, rate, t = hits.position[there], hits.rate[there], hits.truth.depth[there]
    u, v, z = (position - (position[:, 2] / rate[:, 2])[:, None] * rate).T
    np.testing.assert_allclose(z, 0.0, atol=1e-12)
    y, x = np.nonzero(there)
    rays = np.column_stack([x + 0.5, y + 0.5, np.ones(len(x))]) @ shot.camera.world_from_pixel.T
    top = shot.camera.center + (t - position[:, 2] / rate[:, 2])[:, None] * rays
    np.testing.assert_allclose(top, np.column_stack([2 * u - 1, 1 - 2 * v, 0 * u]), atol=1e-6)


def test_doubt_covers_the_edge_of_a_polygon():
    """A ray at the border of a polygon may hit or miss it; nothing else is doubtful."""
    shot = choose_cases(["mesh-surface-highest"])[0].build()
    hits = oracle.cast_relief(shot.source, oracle.relief_of(shot.source), shot.camera, "flat")
    assert (~hits.truth.clear(1e-3 * hits.texel)).sum() <= 2


def test_doubt_where_prisms_overlap_and_nowhere_else():
    """Slivers fold the shell: two pixels come into a prism below its surface; a sound shell has none such."""
    for name, folded in (("mesh-degenerate-slivers", 2), ("mesh-tiled", 0), ("mesh-uv-mirrored", 0)):
        shot = choose_cases([name])[0].build()
        cast = partial(oracle._cast, oracle._shell_lines(shot.source), oracle.relief_of(shot.source), shot.camera)
        plain, strict = (cast(pixel_centers(shot.camera), strict=strict)[0] for strict in (False, True))
        assert (strict >= plain).all()
        assert (strict > plain + 1e-6).sum() == folded


def test_the_solid_may_begin_at_the_top_at_borders_and_at_seams():
    faces = np.array([[0, 1, 2], [2, 1, 3], [3, 1, 4], [5, 5, 6]])
    places = np.array([(0, 0), (1, 0), (0, 1), (1, 1), (2, 0), (8, 8), (9, 9)], float)
    uv = places[faces] + np.array([0.0, 2.0, 0.3, 0.0])[:, None, None]
    walls = oracle._walls(faces, uv)
    assert walls.tolist() == [[True, False, True], [False, True, True], [True, True, True], [True, False, False]]
    rank, prism = np.arange(3), oracle.TETRAHEDRA[0]
    assert oracle._is_free(prism, 3, walls[0], rank)  # through the top
    assert [oracle._is_free(prism, gate, walls[0], rank) for gate in (0, 1, 2)] == [False, True, False]
