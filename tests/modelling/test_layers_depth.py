"""How many depth levels the layers get when nobody says."""

from __future__ import annotations

import numpy as np
import pytest

from ibrpipe.modelling.layers import enough_bits, quantize


@pytest.mark.parametrize("reach", [0.01, 1.0, 37.0])
@pytest.mark.parametrize("texel", [0.5, 0.01, 0.0003])
def test_steps_are_at_most_a_sixteenth_of_a_texel_and_no_finer_than_needed(reach: float, texel: float) -> None:
    depth = np.linspace(2.0, 2.0 + reach, 4001)
    bits = enough_bits(depth, texel)
    rounded = quantize(depth, bits)
    slack = 2e-6 * (2.0 + reach)  # float32
    assert np.abs(rounded - depth).max() <= texel / 32 + slack
    assert bits == 8 or reach / (2 ** (bits - 1) - 1) > texel / 16


def test_nothing_and_a_plane_get_the_fewest() -> None:
    assert enough_bits(np.empty(0), 0.1) == 8
    assert enough_bits(np.full(5, 3.0), 0.1) == 8
