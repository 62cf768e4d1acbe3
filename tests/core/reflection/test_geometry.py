"""Where hits lie in their patches."""

from __future__ import annotations

import numpy as np
import pytest
import reflection_twin
from kernel_runs import on_all_thread_counts

from ibrpipe.core.reflection.geometry import place_hits
from ibrpipe.core.reflection.model import TRAITS


@pytest.mark.parametrize("count", [0, 1, 300])
def test_hits_lie_in_their_patch_and_have_the_normal_between_its_samples(count):
    rng = np.random.default_rng(3)
    records = np.zeros((9, 8), np.int32)
    records[:, 0], records[:, 1], records[:, 2] = rng.integers(0, 5, 9), rng.integers(0, 4, 9), np.arange(9) % 2
    records[:, 4:] = rng.integers(0, 12, (9, 4))
    records[:, 4:][rng.random((9, 4)) < 0.3] = -1
    records[8, 4:] = -1  # no sample
    poses = np.stack([np.eye(4), np.array([[4.0, 0, 3, 0], [0, 4.0, 2, 0], [0, 0, 0, -1], [0, 0, 1, 0]])])
    normals = rng.normal(size=(12, 3)).astype(np.float32)
    normals[5] = np.nan
    points, ids = rng.uniform(1, 4, (count, 3)), rng.integers(-1, 9, count)

    def place():
        traits, found = np.full((count, TRAITS), 7, np.float32), np.zeros((count, 3), np.float32)
        place_hits(points, ids, records, poses, normals, traits, found)
        return traits, found

    traits, found = on_all_thread_counts(place)
    assert (traits[:, 2:] == 7).all()
    for point, which, trait, normal in zip(points, ids, traits, found):
        if which < 0:
            assert (trait[:2] == 7).all()
            assert np.isnan(normal).all()
            continue
        record, (x, y, _, q) = records[which], poses[records[which, 2]] @ np.append(point, 1.0)
        at = np.clip((x / q - record[0], y / q - record[1]), 0, 1)
        np.testing.assert_allclose(trait[:2], at, atol=1e-6)
        weights = reflection_twin.corner_weights(record[4:], *at)
        samples = [] if weights is None else [(w, normals[n]) for w, n in zip(weights, record[4:]) if w > 0]
        mean = sum((w * each.astype(float) for w, each in samples), np.zeros(3)) if samples else np.full(3, np.nan)
        np.testing.assert_allclose(normal, mean / np.linalg.norm(mean), atol=1e-6)
