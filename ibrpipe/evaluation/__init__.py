"""Measuring a run: scores, baselines, timing, surfaces, and the report."""
