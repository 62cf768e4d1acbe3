"""Rays against meshes by Embree: what the wrapper adds."""

from __future__ import annotations

import numpy as np

from ibrpipe.embree import MeshCaster
from ibrpipe.synthetic.surfaces import ball, lobed_ball


def test_no_rays_meet_nothing() -> None:
    caster = MeshCaster(ball(lobed_ball(1.0, 1, 0.0, 1.0), 12, 6).mesh)
    ray, hits = caster.cast_all(np.zeros((0, 3)), np.zeros((0, 3)))
    assert ray.shape == (0,)
    assert ray.dtype == np.int64
    assert hits.t.shape == hits.face.shape == (0,)
    assert hits.normal.shape == (0, 3)
    assert hits.uv.shape == (0, 2)


def test_every_meeting_is_listed_by_ray_and_from_near_to_far() -> None:
    caster = MeshCaster(ball(lobed_ball(1.0, 1, 0.0, 1.0), 120, 60).mesh)
    origins = np.array([[-3.0, 0.013, 0.017], [-3.0, 5.0, 0.0], [-3.0, 0.311, 0.217]])
    ray, hits = caster.cast_all(origins, np.tile([1.0, 0.0, 0.0], (3, 1)))
    assert ray.tolist() == [0, 0, 2, 2]
    half = np.sqrt(1 - (origins[[0, 2], 1:] ** 2).sum(axis=1))
    np.testing.assert_allclose(hits.t.reshape(2, 2), np.stack([3 - half, 3 + half], axis=1), atol=2e-3)
    assert (hits.normal[::2, 0] < 0).all()
    assert (hits.normal[1::2, 0] > 0).all()
