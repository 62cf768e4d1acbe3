"""Kernels of hierarchical image-based rendering: prefiltered slices of parts, their choice, order and compositing."""
