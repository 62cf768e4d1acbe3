"""Planes through inverse depth against the plain twin: slopes, steps, holes, lines."""

import numba
import numpy as np
import patchmatch_twin as twin
import pytest

from ibrpipe.core.patchmatch.plane_fit import fit_planes


def fitted(inverse, radius=2, tolerance=0.02):
    planes = np.empty((3, *inverse.shape), np.float32)
    fit_planes(inverse, radius, tolerance, planes)
    return planes


@pytest.fixture
def slope():
    y, x = np.mgrid[:14, :17]
    return (1 + 0.01 * x - 0.005 * y).astype(np.float32)


def test_a_plane_is_found_exactly(slope):
    planes = fitted(slope)
    assert np.abs(planes[0] - slope).max() < 1e-6
    assert np.abs(planes[1] - 0.01).max() < 1e-6
    assert np.abs(planes[2] + 0.005).max() < 1e-6


def test_against_the_twin(slope):
    rng = np.random.default_rng(4)
    inverse = slope + rng.normal(0, 0.004, slope.shape).astype(np.float32)
    inverse[:, 9:] += 0.3
    inverse[rng.random(inverse.shape) < 0.3] = 0
    inverse[6, :] = inverse[:, 3] = 0
    got, wanted = fitted(inverse), twin.fit_planes(inverse, 2, 0.02)
    assert np.abs(got - wanted).max() < 1e-6
    assert (got[0][inverse == 0] == 0).all()


def test_a_step_is_kept():
    inverse = np.full((9, 12), 0.5, np.float32)
    inverse[:, 6:] = 0.8
    assert np.abs(fitted(inverse)[0] - inverse).max() < 1e-6


def test_lines_single_pixels_and_empty_maps_are_level():
    inverse = np.zeros((7, 9), np.float32)
    inverse[3, :], inverse[0, 0] = 0.5, 0.7
    planes = fitted(inverse)
    assert (planes[0] == inverse).all()
    assert (planes[1:] == 0).all()
    assert fitted(np.zeros((0, 5), np.float32)).shape == (3, 0, 5)


def test_the_number_of_threads_changes_no_byte(slope):
    first = fitted(slope)
    numba.set_num_threads(1)
    try:
        assert fitted(slope).tobytes() == first.tobytes()
    finally:
        numba.set_num_threads(numba.config.NUMBA_NUM_THREADS)
