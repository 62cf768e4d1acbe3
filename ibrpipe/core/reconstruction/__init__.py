"""Depth maps to surfaces: fusion, signed distances, surface nets, triangulation."""
