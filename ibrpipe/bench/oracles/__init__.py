"""Exact, slow answers that renderers are measured against."""
