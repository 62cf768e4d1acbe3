"""Numba and NumPy functions on arrays and numbers: no class, no file, no exception."""
