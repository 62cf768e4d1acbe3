"""Reading many texels of a pyramid at once: as one after another."""

from __future__ import annotations

import numpy as np
import pytest
import relief_shade_twin as twin

from ibrpipe.core.relief_mesh.mips import build_mips, read_points


@pytest.mark.parametrize("wraps", [True, False])
def test_points_are_read_as_the_twin_reads_each(wraps):
    rng = np.random.default_rng(3)
    texels, table = build_mips(rng.random((12, 10, 4)))
    levels = [texels[first : first + rows * columns].reshape(rows, columns, 4) for first, rows, columns in table]
    places, feet = rng.uniform(-1, 2, (40, 2)), rng.normal(0, 0.2, (40, 4))
    found = np.empty((40, 4))
    read_points(texels, table, wraps, places, feet, 8, found)
    for place, foot, got in zip(places, feet, found, strict=True):
        want = twin.read(levels, wraps, *place, np.array([[foot[0], foot[2]], [foot[1], foot[3]]]), 8)
        np.testing.assert_allclose(got, want, atol=1e-5)
