"""Forests of copies: the renderer `hierarchical` against ray casting with instances, at equal error."""
