"""Searches that several renderers share: epipolar lines, quadtrees, projected patches."""
