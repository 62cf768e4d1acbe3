"""Even directions on the sphere."""

import numpy as np


def spread_directions(count):
    """(count, 3) float64 unit directions along a spiral of golden turns, from +z to -z."""
    z = 1.0 - (2.0 * np.arange(count) + 1.0) / count
    turn = np.arange(count) * np.pi * (3.0 - np.sqrt(5.0))
    ring = np.sqrt(1.0 - z * z)
    return np.stack([ring * np.cos(turn), ring * np.sin(turn), z], axis=1)
