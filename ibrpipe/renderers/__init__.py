"""Thin, checked wrappers around the kernels of :mod:`ibrpipe.core`, found by name in the registry."""
