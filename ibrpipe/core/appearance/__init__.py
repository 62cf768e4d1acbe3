"""Colours from photos: blending, the diffuse median, and what misplacement explains."""
