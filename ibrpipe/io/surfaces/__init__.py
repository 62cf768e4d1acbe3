"""Meshes, their materials, and relief images."""
